"""The emulated camera: a machine with automatics, a readout and a plug, which shares the twin's truth."""

from __future__ import annotations

import asyncio
from pathlib import Path

import aiohttp
import numpy as np
import pytest

from drivers.camera.darkroom import Developed, InProcess, Order, WorkerProcess
from drivers.camera.darkroom import develop as develop_here
from drivers.camera.emulator import CameraEmulator
from drivers.twin import TruthLog, Twin, read_truth
from drivers.twin import commands as c
from drivers.twin.renderer import StereoRenderer
from tests.contract.rigs.camera import end
from tests.drivers.camera.rig import opened, plugged, run
from tests.drivers.camera.test_stereo_usb import apart, now
from tests.drivers.twin import rig


async def rest(frames: int) -> None:
    """So long that the camera takes at least so many pictures, unless the machine is very busy."""
    await asyncio.sleep((frames + 1) / 15.0)


def test_the_truth_tells_once_what_was_to_be_seen_from_where_the_rover_rests(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"

    async def main() -> None:
        twin = rig.twin(truth=TruthLog(path))
        async with plugged(twin) as camera, opened(twin, camera.url):
            await rest(8)
            twin.apply(now(), c.WorldPush(0.05, 0.0, 0.0))
            await rest(8)
        twin.close_truth()

    run(main)
    views = read_truth(path).processes[0].views
    assert [view.base[0] for view in views] == pytest.approx([0.0, 0.05])
    assert views[0].sequence < views[1].sequence
    told = tmp_path / "told.jsonl"
    machine = rig.twin(truth=TruthLog(told))
    machine.expose(0.0, 0.004, 1.0, 1)
    machine.close_truth()
    assert read_truth(told).processes[0].views[0].fruits == views[0].fruits


def test_while_the_rover_moves_no_view_is_told(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"

    async def main() -> None:
        twin = rig.twin(truth=TruthLog(path))
        async with plugged(twin) as camera, opened(twin, camera.url):
            await rest(4)
            before = now()
            while now() < before + 0.8:
                twin.apply(now(), c.WheelsDrive(0.2, 0.0))
                await asyncio.sleep(0.05)
        twin.close_truth()

    run(main)
    assert [view.base[0] for view in read_truth(path).processes[0].views] == [0.0]


class _Counted(InProcess):
    orders = 0

    async def develop(self, order: Order) -> Developed:
        self.orders += 1
        return await super().develop(order)


def test_nothing_is_rendered_while_nobody_looks() -> None:
    async def main() -> None:
        twin = rig.twin()
        darkroom = _Counted(lambda: twin.renderer)
        camera = CameraEmulator(twin, asyncio.get_running_loop().time, darkroom)
        await camera.plug()
        life = asyncio.create_task(camera.serve())
        before = darkroom.orders
        await rest(5)
        assert darkroom.orders == before
        async with opened(twin, camera.url):
            assert camera.watched
        assert darkroom.orders > before
        await rest(5)  # the camera notices at its next frame that nobody is there
        assert not camera.watched
        await end(life)

    run(main)


def test_a_process_of_its_own_makes_the_same_pictures() -> None:
    async def main() -> None:
        twin = rig.twin()
        worker = WorkerProcess(twin.scene, twin.nominal.optics, twin.seed)
        order = Order(twin.shot(0.0), 0.004, 1.0, 3, views=frozenset({"stream", "left"}), truth=True)
        there = await worker.develop(order)
        here = develop_here(StereoRenderer(twin.greenhouse, twin.nominal.optics, twin.seed), order)
        assert there.jpegs == here.jpegs
        assert there.seen is not None
        assert here.seen is not None
        assert [view.id for view in there.seen] == [view.id for view in here.seen]
        assert [view.visible_fraction for view in there.seen] == [view.visible_fraction for view in here.seen]
        worker.close()

    run(main)


async def ask(camera: CameraEmulator, method: str, body: object = None) -> tuple[int, dict[str, dict[str, float]]]:
    address = camera.url_of("controls")
    async with aiohttp.ClientSession() as session, session.request(method, address, json=body) as answer:
        return answer.status, (await answer.json() if answer.status == 200 else {})


def test_controls_are_clamped_and_rounded_as_a_uvc_camera_does() -> None:
    async def main() -> None:
        async with plugged(rig.twin()) as camera:
            _, at_first = await ask(camera, "GET")
            assert at_first["auto_exposure"]["value"] == at_first["auto_white_balance"]["value"] == 1.0
            before = at_first["exposure_s"]["value"]
            _, driven = await ask(camera, "POST", {"exposure_s": 0.002})
            assert driven["exposure_s"]["value"] == before  # its automatic is on
            _, told = await ask(camera, "POST", {"auto_exposure": 0, "exposure_s": 7.0, "gain": 2.03})
            assert told["exposure_s"]["value"] == told["exposure_s"]["high"]
            assert told["gain"]["value"] == 2.0

    run(main)


@pytest.mark.parametrize("body", [{"zoom": 3}, {"gain": "high"}, [1, 2], "gain"])
def test_nonsense_sent_to_the_controls_is_refused(body: object) -> None:
    async def main() -> None:
        async with plugged(rig.twin()) as camera:
            before = await ask(camera, "GET")
            assert (await ask(camera, "POST", body))[0] == 400
            assert await ask(camera, "GET") == before

    run(main)


def test_the_automatic_exposure_finds_a_middle_grey_by_itself() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as device:
            await device.set_exposure(0.0005, 1.0)
            dark = (await device.capture()).left.mean()
            await ask(camera, "POST", {"auto_exposure": 1})
            await rest(14)
            grey = (await device.capture()).left.mean()
            assert abs(grey - 118.0) < 15.0 < abs(dark - 118.0)

    run(main)


def test_an_unplugged_camera_refuses_and_comes_back_at_the_same_address() -> None:
    async def main() -> None:
        async with plugged(rig.twin()) as camera:
            address = camera.url
            await camera.unplug()
            with pytest.raises(aiohttp.ClientConnectorError):
                await ask(camera, "GET")
            await camera.plug()
            assert camera.url == address
            assert (await ask(camera, "GET"))[0] == 200

    run(main)


def test_the_unplugged_fault_pulls_the_plug_and_pushes_it_in_again() -> None:
    async def main() -> None:
        async with plugged(rig.twin("camera:unplugged@0.3s+0.7s")) as camera:
            await asyncio.sleep(max(0.0, 0.6 - now()))
            assert not camera.plugged
            await asyncio.sleep(max(0.0, 1.5 - now()))
            assert camera.plugged

    run(main)


async def first_sight_s(twin: Twin) -> float:
    """How long after the rover was pushed a picture shows it."""
    async with plugged(twin) as camera, opened(twin, camera.url) as device:
        before = (await device.capture()).left
        noise = apart(before, (await device.capture()).left)
        pushed_s = now()
        twin.apply(pushed_s, c.WorldPush(0.1, 0.0, 0.0))
        while apart(before, (await device.capture()).left) < 3.0 * noise:
            assert now() < pushed_s + 10.0
        return now() - pushed_s


def test_a_slow_camera_reads_out_ten_times_as_long() -> None:
    async def main() -> None:
        twin = rig.twin("camera:slow")
        assert await first_sight_s(twin) >= 10.0 * twin.nominal.camera_readout_s

    run(main)


def test_two_viewers_get_the_same_pictures() -> None:
    async def main() -> None:
        twin = rig.twin()
        async with plugged(twin) as camera, opened(twin, camera.url) as one, opened(twin, camera.url) as other:
            frames = await asyncio.gather(one.capture(), other.capture())
            assert np.array_equal(frames[0].left, frames[1].left) or apart(frames[0].left, frames[1].left) < 4.0

    run(main)
