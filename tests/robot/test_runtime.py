"""Coming up, waiting, and going down: ``run_robot`` apart from missions."""

import asyncio
import signal

import pytest

from drivers.relay.values import Channel
from drivers.twin.commands import WorldEstop, WorldTilt
from drivers.twin.truth_record import read_truth
from robot import safety
from robot.commands.run import single_error
from robot.errors import BusyError, ConfigError, UnavailableError, UsageError
from robot.ledger import Ledger
from robot.mission import State
from robot.runtime import ledger_path
from tests.robot.mission.rover import Run, World, spray_row
from tests.robot.mission.truths import last_process, motions_asked_after, openings_asked_after

HERE = {"stops_m": (0.25,), "length_m": 0.5}


def waits(folder, signal_number: signal.Signals = signal.SIGTERM, **more) -> Run:
    """Up without --start, and told to end after five seconds."""

    async def end(_world: World) -> None:
        await asyncio.sleep(5.0)
        signal.raise_signal(signal_number)

    return spray_row(folder, meddler=end, start=False, **HERE, **more)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_without_start_it_waits_disarmed_until_a_signal_and_moves_nothing(number, tmp_path):
    run = waits(tmp_path, number)
    process = last_process(run)
    assert run.result.mode is safety.Mode.DISARMED
    assert run.result.state is State.IDLE
    assert run.result.task_id is None
    assert run.last_s == pytest.approx(5.0, abs=0.5)
    assert motions_asked_after(process, 0.0) == openings_asked_after(process, 0.0) == []
    assert run.twin.base_pose == (0.0, 0.0, 0.0)
    assert not any(run.twin.coils(run.twin.now_s).values())


def test_a_device_that_fails_while_it_waits_disarmed_is_told_and_latches_nothing(tmp_path):
    run = waits(tmp_path, faults=("arm:off@2s",))
    assert "arm: expected an answer" in run.said
    assert run.result.mode is safety.Mode.DISARMED


def test_the_e_stop_while_it_waits_latches(tmp_path):
    async def press(world: World) -> None:
        await asyncio.sleep(1.0)
        world.suffer(WorldEstop(True))
        await asyncio.sleep(1.0)
        signal.raise_signal(signal.SIGTERM)

    run = spray_row(tmp_path, meddler=press, start=False, **HERE)
    assert run.result.mode is safety.Mode.ESTOP


@pytest.mark.parametrize(
    ("command", "words"), [(WorldEstop(True), "the e-stop was pressed"), (WorldTilt(0.4, 0.0), "the rover tilts")]
)
def test_it_does_not_start_a_machine_that_is_not_fit(command, words, tmp_path):
    async def spoil(world: World) -> None:
        world.suffer(command)

    with pytest.raises(ExceptionGroup) as caught:
        spray_row(tmp_path, meddler=spoil, **HERE)
    error = single_error(caught.value)
    assert isinstance(error, UnavailableError)
    assert words in str(error)
    after = read_truth(tmp_path / "truth.jsonl").processes[-1]
    assert motions_asked_after(after, 0.0) == openings_asked_after(after, 0.0) == []


@pytest.mark.parametrize("device", ["relay", "arm", "wheels", "inputs", "camera", "gps", "modem"])
def test_a_device_that_is_missing_is_named_with_a_remedy(device, tmp_path):
    with pytest.raises(UnavailableError, match=f"{device}: expected .* found silence; check its power and its cable"):
        spray_row(tmp_path, faults=(f"{device}:off",), **HERE)


def test_a_ledger_that_another_holds_is_refused_before_anything_is_opened(tmp_path):
    (tmp_path / "run").mkdir()
    with Ledger.open(ledger_path(tmp_path / "run")), pytest.raises(BusyError, match=r"ledger\.sqlite"):
        spray_row(tmp_path, **HERE)
    assert read_truth(tmp_path / "truth.jsonl").processes[-1].commands == ()


def test_a_row_on_the_other_side_than_the_rig_faces_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="stands at the right, the rig faces left"):
        spray_row(tmp_path, side="right", rig={"side": "left"}, **HERE)


def test_a_row_ends_with_every_output_off_and_the_arm_stowed(tmp_path):
    run = spray_row(tmp_path, **HERE)
    assert run.result.state is State.DONE
    assert not any(run.twin.coils(run.twin.now_s).values())
    assert run.twin.joints_rad == pytest.approx(run.config.arm.stow_rad, abs=0.02)
    assert run.twin.physics.servos.torque_on
    assert Channel.CONTACTOR in run.twin.coils(run.twin.now_s)


def test_the_same_seed_gives_the_same_row_to_the_last_bit(tmp_path):
    one, other = (spray_row(_folder(tmp_path, name), **HERE) for name in ("one", "other"))
    assert one.last_s == other.last_s
    assert [shot.intent for shot in one.shots] == [shot.intent for shot in other.shots]
    assert [shot.result for shot in one.shots] == [shot.result for shot in other.shots]
    assert one.truth.delivered == other.truth.delivered


def test_another_seed_is_another_row(tmp_path):
    one, other = (
        spray_row(_folder(tmp_path, str(seed)), twin={"seed": seed}, start=False, meddler=_end_soon, **HERE)
        for seed in (1, 2)
    )
    assert one.truth.fruits != other.truth.fruits


async def _end_soon(_world: World) -> None:
    await asyncio.sleep(1.0)
    signal.raise_signal(signal.SIGTERM)


def _folder(parent, name):
    (parent / name).mkdir()
    return parent / name


def test_resume_without_a_former_run_is_a_usage_error(tmp_path):
    with pytest.raises(UsageError, match="to resume"):
        spray_row(tmp_path, resume=True, **HERE)
