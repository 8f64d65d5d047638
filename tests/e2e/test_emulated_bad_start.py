"""A port is wrong when the robot comes up: it is named with its remedy, and nothing was moved or opened."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.arm.protocol2 import Instruction, Packet, PacketReader
from drivers.byte_trace import read_trace

from .rover_process import SPRAYER

CONFIGS = Path(__file__).parents[2] / "configs"
START_S = 20.0  # the program itself takes a while to start on a busy machine; the drivers' own limit is 3 s
READING = {1, 2, 3, 4}  # Modbus functions that change nothing
LOOKING = {Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ}
OTHER_WAIST = json.dumps({"ids": [1], "model": "XM430-W350"})


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """An emulated rover, and the environment that sends the configuration to it."""
    links = tmp_path_factory.mktemp("links")
    rover = subprocess.Popen([*SPRAYER, "emulate", "--json", "--links", str(links)], stdout=subprocess.PIPE, text=True)
    assert rover.stdout is not None
    ports = json.loads(rover.stdout.readline())
    told = {f"SPRAYER_{name.upper()}__PORT": str(links / name) for name in ("arm", "relay", "gps", "modem", "wheels")}
    yield told | {"SPRAYER_INPUTS__PORT": str(links / "relay"), "SPRAYER_CAMERA__DEVICE": ports["camera"]}
    rover.terminate()
    assert rover.wait(20.0) == 0
    rover.stdout.close()


def come_up(places: dict[str, str], folder: Path, **changed: str) -> tuple[int, str, float]:
    """Exit code, message and seconds of a run whose places differ as ``changed`` says."""
    command = [*SPRAYER, "run", "--config", str(CONFIGS / "emulated.toml"), "--out", str(folder / "out")]
    began_s = time.monotonic()
    done = subprocess.run(
        [*command, "--trace", str(folder / "bytes")], env=os.environ | places | changed, capture_output=True, text=True,
        timeout=60.0, check=False,
    )  # fmt: skip
    return done.returncode, done.stderr, time.monotonic() - began_s


def sent(folder: Path, device: str) -> list[bytes]:
    """What went out on a device's port, chunk by chunk; [] when it was never opened."""
    file = folder / "bytes" / f"{device}.trace.jsonl"
    return [chunk.data for chunk in read_trace(file)[1] if chunk.direction == "out"] if file.exists() else []


CASES = [
    # what differs, exit code, what a person reads
    ({"SPRAYER_ARM__PORT": "/dev/ttyNOWHERE"}, 69, "arm: expected a serial device at /dev/ttyNOWHERE"),
    ({"SPRAYER_ARM__PORT": "gps", "SPRAYER_GPS__PORT": "arm"}, 69, "another device is on this port"),
    ({"SPRAYER_WHEELS__PORT": "arm", "SPRAYER_ARM__PORT": "wheels"}, 69, "wheels: expected a ZLAC8015D"),
    ({"SPRAYER_RELAY__PROFILE": "wb-mr6"}, 69, "relay: expected a Wiren Board WB-MR6"),
    ({"SPRAYER_ARM__SERVOS__WAIST": OTHER_WAIST}, 69, "XM430-W350"),
    ({"SPRAYER_GPS__PORT": "relay"}, 78, "give each its own port"),
]


@pytest.mark.parametrize(("changed", "code", "words"), CASES, ids=[words for _, _, words in CASES])
def test_what_is_wrong_at_the_start_is_named_and_nothing_moves(
    changed: dict[str, str], code: int, words: str, places: dict[str, str], tmp_path: Path
) -> None:
    swapped = {key: places.get(f"SPRAYER_{value.upper()}__PORT", value) for key, value in changed.items()}
    returned, said, took_s = come_up(places, tmp_path, **swapped)
    assert returned == code, said
    assert words in said
    assert took_s < START_S
    for packet in PacketReader().feed(b"".join(sent(tmp_path, "arm"))):
        assert not isinstance(packet, Packet) or packet.instruction in LOOKING
    if "RELAY" in "".join(changed):
        assert all(frame[1] in READING for frame in sent(tmp_path, "relay"))


def test_a_port_that_another_process_holds_is_busy_and_its_holder_is_named(
    places: dict[str, str], tmp_path: Path
) -> None:
    reading = subprocess.Popen(
        [*SPRAYER, "gps", "read", places["SPRAYER_GPS__PORT"], "--seconds", "30"], stdout=subprocess.PIPE, text=True
    )
    assert reading.stdout is not None
    reading.stdout.readline()
    returned, said, _ = come_up(places, tmp_path)
    reading.terminate()
    reading.wait(10.0)
    reading.stdout.close()
    assert returned == 75, said
    assert f"process {reading.pid} (" in said
