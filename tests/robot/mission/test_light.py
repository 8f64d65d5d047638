"""The light of a mission: exposure and lamp follow the day, and where it is too dark nothing is sprayed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.camera.mock import MockCamera
from drivers.errors import DeviceRefused
from drivers.relay.values import Channel
from robot.mission import State
from robot.safety import Mode
from robot.vision.light import LightState

from .conftest import SHORT
from .rover import Run, World, spray_row
from .truths import last_process, openings

GOAL = 0.10


def at_hour(hour: float) -> dict[str, object]:
    return {**SHORT, "twin": {"fruits_per_plant": 2.5, "hour": hour}}


def lights(run: Run):
    found = [stop.record.light for stop in run.evidence.stops]
    assert all(found)
    return found


def lamp_switches(run: Run) -> list[tuple[str, float]]:
    return [
        (event.what, event.t) for event in last_process(run).events
        if event.what in ("coil_on", "coil_off") and event.detail["channel"] == "lamp"
    ]  # fmt: skip


def leaf_level(run: Run, stop: int) -> float:
    """Mean linear green of the leaves in the frame that was used: greener than red and blue by a quarter."""
    view = next(frame.frame.left for frame in run.frames if frame.stop == stop) / 255.0
    light = np.where(view <= 0.04045, view / 12.92, ((view + 0.055) / 1.055) ** 2.4)
    blue, green, red = light[..., 0], light[..., 1], light[..., 2]
    return float(green[(green > 1.25 * red) & (green > 1.25 * blue)].mean())


def test_at_noon_no_picture_is_taken_twice(undisturbed):
    assert len(last_process(undisturbed).views) == len(undisturbed.evidence.stops) == 2
    for light in lights(undisturbed):
        assert (light.state, light.exposure_s, light.gain, light.lamp) == (LightState.GOOD, 0.004, 1.0, False)


@pytest.mark.parametrize("hour", [17.0, 19.0])
def test_the_exposure_follows_the_evening(hour, undisturbed, tmp_path):
    run = spray_row(tmp_path, **at_hour(hour))
    assert run.result.state is State.DONE
    assert len(run.shots) == len(undisturbed.shots)
    for light, frame in zip(lights(run), run.frames, strict=True):
        assert light.state is LightState.GOOD
        assert GOAL / 1.5 <= light.plant_level <= GOAL * 1.5
        assert light.exposure_s * light.gain > 0.0055
        assert (frame.frame.exposure_s, frame.frame.gain) == (light.exposure_s, light.gain)
    for stop in (1, 2):
        assert leaf_level(run, stop) == pytest.approx(leaf_level(undisturbed, stop), rel=0.5)
    looked = last_process(run).views
    assert len(looked) == 3  # metered once at the first stop, looked at twice


def test_a_fixed_exposure_stays(tmp_path):
    run = spray_row(tmp_path, camera={"exposure": "fixed"}, **at_hour(19.0))
    assert run.result.state is State.DONE
    assert [(light.exposure_s, light.gain) for light in lights(run)] == [(0.004, 1.0)] * 2
    assert {light.state for light in lights(run)} == {LightState.DIM}
    assert len(last_process(run).views) == 2


def test_a_camera_that_refuses_is_asked_once_and_used_as_it_is(undisturbed, tmp_path, monkeypatch):
    asked: list[float] = []

    async def refuse(camera: MockCamera, exposure_s: float, gain: float) -> None:
        asked.append(exposure_s)
        raise DeviceRefused("camera", "the exposure of the recording", f"{exposure_s:g} s", "cannot be exposed anew")

    monkeypatch.setattr(MockCamera, "set_exposure", refuse)
    run = spray_row(tmp_path, **at_hour(19.0))
    assert run.result.state is State.DONE
    assert len(asked) == 1
    assert len(run.shots) == len(undisturbed.shots)
    assert {light.remark for light in lights(run)} == {"the exposure is fixed: expected the exposure of the recording"}
    assert sum(event.kind == "light" for event in run.events) == 1


def test_a_camera_with_narrower_bounds_than_configured_goes_to_its_own(tmp_path):
    """The mock's gain ends at 16, the configuration says 32."""
    run = spray_row(tmp_path, camera={"max_gain": 32.0}, **at_hour(20.0))
    assert run.result.state is State.DONE
    assert all(12.0 < light.gain <= 16.0 and light.exposure_s == pytest.approx(0.02) for light in lights(run))


def test_a_mission_that_begins_in_the_dark_with_a_short_exposure_finds_its_way(tmp_path):
    """Its first pictures are black, which is no fault while the exposure can be raised."""
    run = spray_row(tmp_path, camera={"exposure_s": 0.0001}, **at_hour(20.0))
    assert run.result.state is State.DONE
    assert {light.state for light in lights(run)} == {LightState.DIM}
    assert lights(run)[0].exposure_s * lights(run)[0].gain == pytest.approx(0.16)


def test_exposures_are_whole_half_periods_of_the_mains(tmp_path):
    run = spray_row(tmp_path, camera={"mains_hz": 60}, **at_hour(19.0))
    for light in lights(run):
        assert light.exposure_s * 120.0 == pytest.approx(round(light.exposure_s * 120.0))


# --- the lamp


def test_at_dusk_the_lamp_is_lit_before_the_first_look_and_stays_lit(undisturbed, tmp_path):
    run = spray_row(tmp_path, camera={"lamp": "auto"}, **at_hour(20.0))
    assert run.result.state is State.DONE
    (lit, lit_s), (out, out_s) = lamp_switches(run)
    assert (lit, out) == ("coil_on", "coil_off")
    assert lit_s < run.frames[0].frame.stamp_s
    assert out_s >= run.states[-1].stamp_s
    assert all(light.lamp and light.state is LightState.GOOD for light in lights(run))
    assert all(light.gain < 8.0 for light in lights(run))
    assert len(run.shots) == len(undisturbed.shots)
    assert any("lamp lit:" in event.text for event in run.events if event.kind == "light")


def test_by_day_the_lamp_stays_off(tmp_path):
    run = spray_row(tmp_path, camera={"lamp": "auto"}, **at_hour(12.0))
    assert lamp_switches(run) == []
    assert not any(light.lamp for light in lights(run))


def test_the_lamp_goes_out_once_the_sun_is_up(tmp_path):
    async def dawn(world: World) -> None:
        await world.until(State.MOVE, 2)
        world.twin.scene = replace(world.twin.scene, hour=10.0)

    run = spray_row(tmp_path, meddler=dawn, camera={"lamp": "auto"}, **at_hour(20.0))
    assert [what for what, _ in lamp_switches(run)] == ["coil_on", "coil_off"]
    assert [light.lamp for light in lights(run)] == [True, False]
    assert lights(run)[1].state is LightState.GOOD


def test_a_lamp_that_somebody_switched_off_is_lit_again(tmp_path):
    from drivers.twin.commands import RelaySwitch

    async def switch_off(world: World) -> None:
        await world.until(State.MOVE, 2)
        world.twin.apply(world.now_s, RelaySwitch(Channel.LAMP, False, world.now_s))

    run = spray_row(tmp_path, meddler=switch_off, camera={"lamp": "on"}, **at_hour(20.0))
    assert [what for what, _ in lamp_switches(run)] == ["coil_on", "coil_off", "coil_on", "coil_off"]
    assert [light.lamp for light in lights(run)] == [True, True]


# --- too dark to trust


def nothing_for_the_dark_stop(run: Run, stop: int) -> None:
    light = next(item.record.light for item in run.evidence.stops if item.record.stop == stop)
    assert light.state is LightState.DARK
    looked_s, _ = run.spans(State.DETECT)[stop - 1]
    assert not [start for start, _ in openings(last_process(run)) if start > looked_s]
    assert stop not in {shot.intent.stop for shot in run.shots}
    assert any(f"stop {stop}: too dark to trust: plants at" in event.text for event in run.events)
    assert f"stop {stop}: too dark to trust" in run.said


def test_a_row_in_the_dark_is_passed_without_a_drop(tmp_path):
    run = spray_row(tmp_path, camera={"exposure": "fixed"}, **at_hour(20.0))
    assert run.result.state is State.DONE
    assert run.twin.dispensed_ml == 0.0
    assert run.targets == ()
    assert [stop.record.fruits_seen for stop in run.evidence.stops] == [0, 0]
    nothing_for_the_dark_stop(run, 1)
    nothing_for_the_dark_stop(run, 2)


def sunset(hour: float):
    async def meddle(world: World) -> None:
        await world.until(State.MOVE, 2)
        world.twin.scene = replace(world.twin.scene, hour=hour)

    return meddle


def test_a_stop_that_darkness_overtakes_is_skipped_with_its_reason(undisturbed, tmp_path):
    run = spray_row(tmp_path, meddler=sunset(20.0), camera={"exposure": "fixed"}, **SHORT)
    assert run.result.state is State.DONE
    assert lights(run)[0].state is LightState.GOOD
    first_stop = [shot for shot in undisturbed.shots if shot.intent.stop == 1]
    assert len(run.shots) == len(first_stop) > 0
    nothing_for_the_dark_stop(run, 2)


def test_darkness_ends_the_mission_where_the_policy_says_so(tmp_path):
    camera = {"exposure": "fixed", "when_dark": "stop"}
    run = spray_row(tmp_path, meddler=sunset(20.0), camera=camera, **SHORT)
    assert run.result.state is State.IDLE
    assert run.result.mode is Mode.SAFE_STOP
    assert "come back by day or light the lamp, then resume" in run.result.causes[0]
    nothing_for_the_dark_stop(run, 2)


def test_noise_is_not_mistaken_for_light(tmp_path):
    """Gain makes the picture bright enough to look at; too few photons are behind it."""
    camera = {"max_exposure_s": 0.004, "max_gain": 16.0}
    run = spray_row(tmp_path, camera=camera, **at_hour(20.0))
    assert run.twin.dispensed_ml == 0.0
    assert all(light.plant_level > 0.006 and light.state is LightState.DARK for light in lights(run))
