"""The truth file, what became of a killed run, and the next process on the same machine."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.relay.values import Channel
from drivers.twin import FaultPlan, TruthLog, Twin, parse_fault, read_truth, resume_from, run_on
from drivers.twin import commands as c
from tests.drivers.twin import rig

SEED = 5


def new(path: Path, *faults: str) -> Twin:
    """As a process begins: a new machine, or the one the process before left."""
    plan = FaultPlan(parse_fault(fault) for fault in faults)
    return resume_from(path, rig.nominal(stow_rad=rig.aimed()[0]), rig.scene(), SEED, plan)


def spray(twin: Twin) -> None:
    """A short life: prime, two shots, a move of arm and base, a third shot; ends in standstill at 14 s."""
    twin.apply(0.1, c.RelayPulse(Channel.PUMP, 20.0, 0.11))
    twin.apply(3.0, c.RelayPulse(Channel.VALVE, 0.4, 3.01))
    twin.apply(4.0, c.RelayPulse(Channel.VALVE, 2.0, 4.01))
    twin.apply(4.5, c.RelaySwitch(Channel.VALVE, False, 4.51))
    for k in range(51):
        at = 5.0 + 0.02 * k
        twin.apply(at, c.ArmGoal(rig.quintic(rig.aimed()[0], (0.3, *rig.aimed()[0][1:]), 1.0, at - 5.0)))
    for k in range(20):
        twin.apply(7.0 + 0.1 * k, c.WheelsDrive(0.2, 0.0))
    twin.apply(9.0, c.WheelsStop())
    twin.apply(11.0, c.RelayPulse(Channel.VALVE, 0.5, 11.01))
    twin.apply(13.0, c.RelayAllOff(13.01))
    twin.advance(14.0)


def end(twin: Twin) -> None:
    """The process dies: the kernel closes its file."""
    twin.truth.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "truth.jsonl"


def test_the_file_tells_the_world_and_its_fruit(path: Path) -> None:
    twin = new(path)
    end(twin)
    record = read_truth(path)
    assert len(record.processes) == 1
    assert {fruit.id for fruit in record.fruits} == {fruit.id for fruit in twin.greenhouse.fruits}
    assert record.processes[0].world["true"]["nozzle_flow_ml_s"] == twin.true.nozzle_flow_ml_s


def test_the_file_tells_what_was_done_and_what_came_of_it(path: Path) -> None:
    twin = new(path)
    spray(twin)
    end(twin)
    record = read_truth(path)
    process = record.processes[0]
    assert process.commands[1].command == c.RelayPulse(Channel.VALVE, 0.4, 3.01)
    assert len(process.delivered) == 3
    assert sum(shot.ml for shot in process.delivered) == pytest.approx(twin.dispensed_ml)
    assert record.fruit_ml == pytest.approx(twin.fruit_ml)
    for shot in process.delivered:
        parts_ml = sum(shot.fruit_ml.values()) + shot.leaf_ml + shot.stem_ml + shot.soil_ml + shot.air_ml
        assert parts_ml == pytest.approx(shot.ml, abs=1e-9)


def test_snapshots_stand_where_motion_begins_and_ends(path: Path) -> None:
    twin = new(path)
    spray(twin)
    end(twin)
    process = read_truth(path).processes[0]
    stopped = next(event for event in process.events if event.what == "base_stopped")
    last = process.states[-1]
    assert tuple(stopped.detail["base"]) == last.base == twin.base_pose
    assert last.joints_rad == pytest.approx(twin.joints_rad)
    assert last.counters_m == twin.physics.drive.counters_m


def test_a_frame_tells_what_was_to_be_seen(path: Path) -> None:
    twin = rig.twin(truth=TruthLog(path))
    twin.expose(1.0, 0.004, 1.0, 15)
    end(twin)
    view = read_truth(path).processes[0].views[0]
    assert (view.t, view.sequence) == (1.0, 15)
    assert view.fruits
    assert all(0.0 <= share <= 1.0 for fruit in view.fruits for share in (*fruit.visible, *fruit.in_image))


def test_every_line_is_on_disk_when_the_machine_answers(path: Path) -> None:
    twin = new(path)
    twin.apply(1.0, c.WheelsDrive(0.1, 0.0))
    assert isinstance(read_truth(path).processes[0].commands[-1].command, c.WheelsDrive)
    end(twin)


def test_a_torn_last_line_is_told_and_left_out(path: Path) -> None:
    twin = new(path)
    spray(twin)
    end(twin)
    whole = read_truth(path)
    path.write_bytes(path.read_bytes()[:-7])
    torn = read_truth(path)
    assert torn.torn
    assert not whole.torn
    assert torn.processes[0].commands == whole.processes[0].commands


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"hello\n", "line 1"),
        (b'{"kind":"command","t":0}\n', "world line first"),
        (b'{"kind":"world","format":999}\n', "format 1"),
    ],
)
def test_what_is_not_a_truth_file_is_refused(path: Path, content: bytes, message: str) -> None:
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_truth(path)


def test_a_second_writer_is_refused(path: Path) -> None:
    twin = new(path)
    with pytest.raises(BlockingIOError, match="no other writer"):
        TruthLog(path)
    end(twin)


def test_a_run_that_was_not_killed_replays_to_what_it_recorded(path: Path) -> None:
    twin = new(path)
    spray(twin)
    end(twin)
    recorded = read_truth(path).processes[0].events
    judged = run_on(path)
    assert judged.events == recorded
    assert judged.total_ml == twin.dispensed_ml
    assert judged.fruit_ml == twin.fruit_ml
    assert judged.after_ml == 0.0
    assert judged.base_pose == twin.base_pose
    openings = [shot.closed_t - shot.opened_t for shot in read_truth(path).delivered]
    assert judged.longest_opening_s == pytest.approx(max(openings))
    assert not judged.valve_open_at_last


def test_a_valve_open_at_the_kill_is_shut_by_the_boards_timer(path: Path) -> None:
    twin = new(path)
    twin.apply(0.0, c.RelayPulse(Channel.PUMP, 20.0, 0.01))
    twin.apply(5.0, c.RelayPulse(Channel.VALVE, 1.2, 5.01))
    twin.advance(5.3)
    end(twin)
    judged = run_on(path)
    assert judged.valve_open_at_last
    assert judged.valve_shut_s == pytest.approx(5.01 + 1.2 + twin.true.valve_close_s)
    assert judged.longest_opening_s == pytest.approx(1.2 + twin.true.valve_close_s - twin.true.valve_open_s)
    assert judged.after_ml > 5.0
    assert not any(judged.coils.values())
    assert sum(judged.fruit_ml.values()) > 1.0


def test_a_frame_on_the_wire_at_the_kill_still_reaches_the_board(path: Path) -> None:
    twin = new(path)
    twin.apply(0.0, c.RelayPulse(Channel.PUMP, 20.0, 0.01))
    twin.apply(5.0, c.RelayPulse(Channel.VALVE, 0.5, 5.01))
    end(twin)
    assert run_on(path).after_ml > 4.0


def test_a_base_driving_at_the_kill_stops_by_its_timeout(path: Path) -> None:
    twin = new(path)
    for k in range(20):
        twin.apply(0.1 * k, c.WheelsDrive(0.3, 0.0))
    end(twin)
    judged = run_on(path)
    gone_m = judged.base_pose[0] - twin.base_pose[0]
    assert 0.3 * 0.5 * 0.9 < gone_m < 0.3 * 0.5 + 0.3**2 / (2 * 0.5)


@pytest.mark.parametrize("share", [0.03, 0.2, 0.35, 0.5, 0.62, 0.75, 0.88, 0.97])
def test_a_file_cut_anywhere_is_judged_as_the_machine_would_have_gone_on(path: Path, share: float) -> None:
    twin = new(path)
    spray(twin)
    end(twin)
    data = path.read_bytes()
    begin = data.index(b"\n") + 1
    path.write_bytes(data[: begin + int(share * (len(data) - begin))])
    alone = rig.twin(seed=SEED, drawn=True, stow_rad=rig.aimed()[0])
    for timed in read_truth(path).processes[0].commands:
        alone.apply(timed.t, timed.command)
    alone.advance(60.0)
    judged = run_on(path)
    assert judged.total_ml == alone.dispensed_ml
    assert judged.fruit_ml == alone.fruit_ml
    assert judged.base_pose == alone.base_pose


def test_the_next_process_finds_the_machine_as_the_last_left_it(path: Path) -> None:
    first = new(path)
    spray(first)
    end(first)
    second = new(path)
    assert second.now_s == 0.0
    assert second.base_pose == first.base_pose
    assert second.joints_rad == pytest.approx(first.joints_rad)
    assert second.fruit_ml == first.fruit_ml
    assert second.dispensed_ml == first.dispensed_ml
    assert second.odometry(0.0).left_m == first.odometry(14.0).left_m > 0.3
    end(second)


def test_a_resumed_file_holds_what_happened_between_the_processes(path: Path) -> None:
    first = new(path)
    first.apply(0.0, c.RelayPulse(Channel.PUMP, 20.0, 0.01))
    first.apply(5.0, c.RelayPulse(Channel.VALVE, 1.2, 5.01))
    first.advance(5.3)
    end(first)
    expected_ml = run_on(path).total_ml
    second = new(path)
    second.apply(1.0, c.RelayPulse(Channel.PUMP, 20.0, 1.01))
    second.apply(6.0, c.RelayPulse(Channel.VALVE, 0.5, 6.01))
    second.advance(8.0)
    end(second)
    record = read_truth(path)
    assert [len(process.delivered) for process in record.processes] == [1, 1]
    assert record.delivered[0].ml == pytest.approx(expected_ml)
    assert record.fruit_ml == pytest.approx(second.fruit_ml)
    assert run_on(path).total_ml == second.dispensed_ml


def test_three_processes_in_a_row_replay_to_the_same_end(path: Path) -> None:
    for _ in range(2):
        twin = new(path)
        twin.apply(0.0, c.RelayPulse(Channel.PUMP, 20.0, 0.01))
        twin.apply(3.0, c.WheelsDrive(0.2, 0.05))
        twin.apply(3.3, c.RelayPulse(Channel.VALVE, 1.0, 3.31))
        end(twin)
    third = new(path)
    pose, ml = third.base_pose, third.dispensed_ml
    end(third)
    judged = run_on(path)
    assert (judged.base_pose, judged.total_ml) == (pose, ml)
    assert len(read_truth(path).processes) == 3


def test_the_faults_of_a_dead_process_do_not_outlive_it(path: Path) -> None:
    first = new(path, "relay:stuck@1s")
    first.advance(2.0)
    end(first)
    second = new(path)
    second.apply(1.0, c.RelayPulse(Channel.LAMP, 1.0, 1.01))
    assert second.coils(1.5)[Channel.LAMP]
    end(second)


def test_another_machine_may_not_write_to_the_file(path: Path) -> None:
    end(new(path))
    with pytest.raises(ValueError, match="another file"):
        resume_from(path, rig.nominal(), rig.scene(), SEED)


def test_a_world_line_torn_at_birth_leaves_an_empty_file_to_begin(path: Path) -> None:
    end(new(path))
    path.write_bytes(path.read_bytes()[:50])
    twin = new(path)
    end(twin)
    assert len(read_truth(path).processes) == 1


_KILLED_WHILE_SPRAYING = """
import os, signal, sys
from pathlib import Path
from drivers.relay.values import Channel
from drivers.twin import TruthLog
from drivers.twin import commands as c
from tests.drivers.twin import rig

twin = rig.twin(truth=TruthLog(Path(sys.argv[1])))
twin.apply(0.0, c.RelayPulse(Channel.PUMP, 20.0, 0.01))
twin.apply(5.0, c.RelayPulse(Channel.VALVE, 0.8, 5.01))
twin.advance(5.2)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_leaves_all_that_was_done_and_the_file_unlocked(path: Path) -> None:
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", _KILLED_WHILE_SPRAYING, str(path)], cwd=root, check=False)
    assert done.returncode == -signal.SIGKILL
    judged = run_on(path)
    assert judged.valve_open_at_last
    assert judged.total_ml == pytest.approx(12.6 * (0.8 - 0.025 + 0.020), rel=0.01)
    twin = resume_from(path, rig.nominal(), rig.scene(), SEED)
    assert twin.dispensed_ml == judged.total_ml
    end(twin)
