"""The installed service under a real systemd, over the emulated rover: it comes up, goes down, and comes back clean."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.relay.values import Channel
from drivers.twin.aftermath import run_on
from drivers.twin.commands import RelayAllOff, RelayPulse, RelaySwitch
from drivers.twin.truth_record import read_truth

from .emulated import EMULATED, variables
from .systemd_box import LIBRARIES, PROGRAM, Box, refusal, systemd_box

pytestmark = pytest.mark.peer

SERVICE, FAILED = "sprayer.service", "sprayer-failed.service"
EMULATOR = "emulator.service"
LINKS = "/run/sprayer-emulated"
START_ONCE = "/var/lib/sprayer/start-once"
STARTED = "/var/lib/sprayer/started"  # the process that was told to
PULSE = '"device":"relay","verb":"pulse","args":{"channel":"valve"'
CONFIG = 78
STARTS = 5
ATTEMPTS = 6
WATCHDOG_S, PET_S, ABORT_S = 5.0, 1.0, 3.0  # as the unit has them
VALVE_LAG_S = 0.1

# Stands before ``sprayer run``: the first life is told to start, and to confirm it, as by a person at a terminal.
AT_A_TERMINAL = f"""#!/bin/sh
exec {{python}} -c 'import os, pty, sys
if os.path.exists("{START_ONCE}"):
    os.rename("{START_ONCE}", "{STARTED}")
    open("{STARTED}", "w").write(str(os.getpid()))
    hand, terminal = pty.openpty()
    os.write(hand, b"spray\\n")
    os.dup2(terminal, 0)
    os.set_inheritable(hand, True)
    sys.argv.append("--start")
os.execv("{PROGRAM}", ["{PROGRAM}", *sys.argv[1:]])' "$@"
"""


@pytest.fixture(scope="module")
def computer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Box]:
    """A box with the service installed as the documentation says, its configuration that of the emulated rover."""
    if why := refusal():
        pytest.skip(f"no real systemd here: {why}")
    shared = tmp_path_factory.mktemp("box")
    with systemd_box(shared) as box:
        box.run(PROGRAM, "install", "--program", PROGRAM)
        (shared / "short.toml").write_text(
            'name = "short"\n[[row]]\nname = "A"\nside = "left"\nlength_m = 1.6\nstops_m = [0.45, 0.85]\n'
        )
        box.run("install", "-D", "/box/short.toml", "/etc/sprayer/routes/short.toml")
        box.put("/opt/sprayer/bin/at-a-terminal", AT_A_TERMINAL.format(python="/usr/bin/python3"), 0o755)
        started = box.run("systemctl", "cat", SERVICE)
        line = next(line for line in started.splitlines() if line.startswith("ExecStart="))
        told = line.replace(PROGRAM, "/opt/sprayer/bin/at-a-terminal")
        changed = f"[Service]\nExecStart=\n{told}\nEnvironment={LIBRARIES}\n"
        box.put(f"/etc/systemd/system/{SERVICE}.d/box.conf", changed)
        box.run("systemctl", "daemon-reload")
        yield box


@pytest.fixture(scope="module")
def rover(computer: Box) -> Iterator[Path]:
    """The emulated rover, where the service looks for it; its truth file."""
    with emulator(computer) as truth:
        yield truth


@pytest.fixture
def machine(computer: Box, rover: Path) -> Iterator[Path]:
    """The same, with the service down before and after, and its journal empty."""
    computer.run("systemctl", "reset-failed", SERVICE, FAILED, ok=(0, 1))
    computer.run("journalctl", "--rotate")
    computer.run("journalctl", "--vacuum-time=1s")
    configure(computer)
    yield rover
    computer.run("systemctl", "stop", SERVICE)


@contextmanager
def emulator(box: Box) -> Iterator[Path]:
    truth, told = box.shared / "truth.jsonl", box.shared / "ports.json"
    box.run(
        "systemd-run", "--unit", EMULATOR, "--collect", "--property", "StandardOutput=truncate:/box/ports.json", "--",
        PROGRAM, "emulate", "--config", "emulated.toml", "--json", "--links", LINKS, "--truth", "/box/truth.jsonl",
    )  # fmt: skip
    box.until("the emulated rover is up", lambda: told.exists() and told.read_text().endswith("\n"))
    ports = json.loads(told.read_text())
    stable = {name: port if "://" in port or ":" in port else f"{LINKS}/{name}" for name, port in ports.items()}
    stable["inputs"] = stable["relay"]
    lines = [f"{name}={value}" for name, value in variables(stable).items() if "NTRIP" not in name]
    box.put("/etc/sprayer/secrets.env", "\n".join(lines) + "\n", 0o600)
    try:
        yield truth
    finally:
        box.run("systemctl", "stop", EMULATOR)


def configure(box: Box, **replaced: str) -> None:
    text = EMULATED.read_text().replace("routes/demo.toml", "routes/short.toml").replace("/tmp/sprayer-emulated", LINKS)
    for section in ("relay", "wheels"):  # a computer with much else to do is late with a wire's bytes
        text = text.replace(f'port = "{LINKS}/{section}"', f'port = "{LINKS}/{section}"\ntimeout_s = 0.5')
    for old, new in replaced.items():
        text = text.replace(old, new)
    box.put("/etc/sprayer/rover.toml", text)


def alive(box: Box) -> dict[str, str]:
    return box.show(SERVICE, "ActiveState", "StatusText", "Result", "MainPID", "ExecMainStatus")


def start(box: Box) -> None:
    """Up and ready; where this computer was too busy to answer a device in time, at one of the next starts."""
    box.run("systemctl", "start", SERVICE, ok=(0, 1))  # returns once it has said READY=1
    box.until("it is up", lambda: alive(box)["ActiveState"] == "active", 120.0)


def hang_in_a_shot(box: Box, truth: Path) -> str:
    """The process that a mission ran in and that stands still since the valve opened; where a mission ended without a
    shot, as it does when this computer cannot keep up with the machine, another is begun.
    """
    configure(box, **{"min_ml = 1.5": "min_ml = 10.0"})  # openings of 0.8 s and more are easier to meet

    def shots() -> int:
        return truth.read_text(errors="replace").count(PULSE)

    for _ in range(ATTEMPTS):
        before = shots()
        box.run("install", "-o", "sprayer", "/dev/null", START_ONCE)
        start(box)
        process = alive(box)["MainPID"]
        looks = itertools.count(1)
        if box.run("cat", STARTED).strip() != process:
            box.run("systemctl", "stop", SERVICE)
            continue
        box.until(
            "a shot, or the end of the mission",
            lambda process=process, before=before, looks=looks: (  # type: ignore[misc]
                shots() > before or (next(looks) % 20 == 0 and alive(box)["MainPID"] != process)
            ),
        )
        if shots() > before:
            box.run("kill", "-STOP", process)
            return process
        box.run("systemctl", "stop", SERVICE)
    raise AssertionError("no mission came to a shot")


def test_the_service_comes_up_disarmed_and_goes_down_clean(computer: Box, machine: Path) -> None:
    start(computer)
    state = alive(computer)
    assert state["StatusText"] == "disarmed"
    assert computer.run("cat", "/run/sprayer/alloff.conf").startswith("sprayer-alloff 1\n")
    owner = computer.run("stat", "--format", "%U", f"/proc/{state['MainPID']}").strip()
    assert owner == "sprayer"
    computer.run("systemctl", "stop", SERVICE)
    state = alive(computer)
    ended = (state["ActiveState"], state["Result"], state["ExecMainStatus"])
    assert ended == ("inactive", "success", "0"), computer.said(SERVICE)
    assert "called because of: success" in computer.said(SERVICE)
    assert "relay: off, read back" in computer.said(SERVICE)


def test_a_process_that_hangs_in_a_shot_is_ended_switched_off_and_comes_back_disarmed(
    computer: Box, machine: Path
) -> None:
    first = hang_in_a_shot(computer, machine)
    computer.until("it is back", lambda: came_back(computer, first))
    assert alive(computer)["StatusText"] == "disarmed"
    said = computer.said(SERVICE)
    assert "Watchdog timeout" in said
    assert "called because of: watchdog" in said
    assert said.count("relay: off, read back") >= 2  # after the kill, and before the new start
    computer.run("systemctl", "stop", SERVICE)
    after = run_on(machine)
    assert not any(after.coils.values())
    orders = [(timed.t, timed.command) for timed in read_truth(machine).processes[-1].commands]
    shots = [
        (t, order.duration_s) for t, order in orders if isinstance(order, RelayPulse) and order.channel is Channel.VALVE
    ]
    assert after.longest_opening_s <= max(duration_s for _, duration_s in shots) + VALVE_LAG_S  # the board shut it
    hung_s = shots[-1][0]
    off = {
        channel: min(t for t, order in orders if t > hung_s and _shuts(order, channel))
        for channel in (Channel.VALVE, Channel.PUMP, Channel.CONTACTOR)
    }
    assert off[Channel.VALVE] > hung_s + WATCHDOG_S - PET_S  # nobody shut it before: the shot was under way
    assert max(off.values()) < hung_s + WATCHDOG_S + ABORT_S + 2.0
    assert not [order for t, order in orders if t > off[Channel.VALVE] and _switches_on(order)]


def _shuts(order: object, channel: Channel) -> bool:
    return isinstance(order, RelayAllOff) or (
        isinstance(order, RelaySwitch) and order.channel is channel and not order.on
    )


def _switches_on(order: object) -> bool:
    return isinstance(order, RelayPulse) or (isinstance(order, RelaySwitch) and order.on)


def came_back(box: Box, first: str) -> bool:
    state = alive(box)
    return state["ActiveState"] == "active" and state["MainPID"] != first


def test_a_wrong_configuration_is_not_tried_again_and_is_reported(computer: Box, machine: Path) -> None:
    start(computer)
    configure(computer, **{"[robot]": "[robot]\nnmae = 1"})
    computer.run("systemctl", "restart", SERVICE, ok=(0, 1))
    computer.until("it has failed", lambda: alive(computer)["ActiveState"] == "failed", 30.0)
    state = alive(computer)
    assert state["ExecMainStatus"] == str(CONFIG)
    assert computer.said(SERVICE).count("unknown key 'robot.nmae'") == 1
    computer.until("it is reported", lambda: "has failed and stays down" in computer.said(FAILED), 20.0)
    reports = [entry for entry in computer.journal(FAILED) if "has failed and stays down" in entry["MESSAGE"]]
    assert reports[0]["PRIORITY"] == "2"
    assert "relay: off, read back" in computer.said(FAILED)


def test_a_killed_process_is_started_again_and_leaves_nothing_on(computer: Box, machine: Path) -> None:
    start(computer)
    first = alive(computer)["MainPID"]
    computer.run("kill", "-KILL", first)
    computer.until("it is back", lambda: came_back(computer, first))
    assert "called because of: signal" in computer.said(SERVICE)
    assert alive(computer)["StatusText"] == "disarmed"


@pytest.mark.long
def test_a_service_that_does_not_stay_up_is_given_up_with_outputs_off(computer: Box, machine: Path) -> None:
    start(computer)
    computer.run("systemctl", "stop", SERVICE)
    computer.run("ln", "-sfn", "/dev/none", f"{LINKS}/arm")  # unplugged
    computer.run("systemctl", "start", SERVICE, ok=(1,))
    computer.until("it is given up", lambda: "Start request repeated too quickly" in computer.said(SERVICE), 180.0)
    assert alive(computer)["ActiveState"] == "failed"
    assert computer.said(SERVICE).count("arm: expected a serial device") == STARTS
    computer.until("it is reported", lambda: "has failed and stays down" in computer.said(FAILED), 20.0)
    assert "relay: off, read back" in computer.said(FAILED)


def test_udev_names_a_port_and_keeps_others_off(computer: Box) -> None:
    rules = "/etc/udev/rules.d/60-sprayer-ports.rules"
    text = computer.run("cat", rules)
    example = '#KERNEL=="ttyAMA0", '
    assert example in text
    computer.put(rules, text.replace(example, 'KERNEL=="tty", '))
    told = computer.run("udevadm", "test", "--action=add", "/sys/class/tty/tty")
    assert "Invalid" not in told
    assert "LINK 'sprayer-relay'" in told
    properties = set(told.splitlines())
    assert {"SPRAYER_PORT=relay", "ID_MM_PORT_IGNORE=1", "ID_MM_DEVICE_IGNORE=1", "TAGS=:systemd:"} <= properties


def test_the_installation_goes_away_and_leaves_what_is_the_operators(computer: Box) -> None:
    edited = "/etc/sprayer/rover.toml"
    computer.put(edited, computer.run("cat", edited) + "# ours\n")
    said = computer.run(PROGRAM, "install", "--program", PROGRAM, "--uninstall")
    assert "keep /etc/sprayer/rover.toml (yours)" in said
    assert "could not be found" in computer.run("systemctl", "status", FAILED, ok=(4,))
    assert os.listdir(computer.shared)
