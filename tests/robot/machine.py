"""The demo machine on its twin, brought up in virtual time without a mission: for tests of actuation and states."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from drivers.arm.values import JointTrajectory
from drivers.errors import DeviceError
from drivers.twin.faults import FaultPlan, parse_fault
from drivers.twin.machine import Twin
from drivers.twin.scene import Scene
from robot import safety
from robot.actuation import Actuation, PulseOrder
from robot.calibration_file import load_rig
from robot.config import load_config
from robot.ledger import Ledger
from robot.ledger.values import Result
from robot.package_files import packaged
from robot.runtime.backends import BuildOptions, build_devices
from robot.runtime.devices import Devices, nominal_machine
from robot.runtime.settings import hand_settings, limits, load_arm, load_row, task
from robot.targets import Target, TargetState
from robot.vision.values import Ripeness

DEMO = packaged("configs") / "demo.toml"
START = datetime(2026, 6, 15, 10, 0, tzinfo=UTC)


@dataclass(frozen=True, eq=False)
class Machine:
    twin: Twin
    devices: Devices
    actuation: Actuation
    ledger: Ledger
    task_id: int
    modes: list[safety.SafetyState]
    polls: list[asyncio.Task[None]]

    async def ready_to_spray(self) -> None:
        """Base at rest, arm settled in front of nothing, pressure up, frame marked."""
        self.actuation.mark_frame()
        await self.actuation.start_pump()
        here = self.actuation.joints_rad
        assert here is not None
        await self.actuation.move_arm(gentle(here, here))
        await asyncio.sleep(4.0)

    def order(self, open_s: float = 0.32, target_id: int = 1, dose_ml: float = 4.0) -> PulseOrder:
        pulse_s = self.actuation.board_pulse_s(open_s)
        model_ml = 12.6 * (open_s - 0.005)
        return PulseOrder(target_id, 1, 1, dose_ml, dose_ml, model_ml, open_s, pulse_s, 15.0 * pulse_s + 1.0)

    async def spray(self, open_s: float = 0.32) -> Result:
        return await self.actuation.spray(self.order(open_s))

    def results(self) -> list[Result]:
        return [shot.result for shot in self.ledger.shots(self.task_id) if shot.result is not None]


def gentle(start: tuple[float, ...], goal: tuple[float, ...], duration_s: float = 1.0) -> JointTrajectory:
    """From rest to rest along a quintic."""
    times = [0.02 * k for k in range(round(duration_s / 0.02) + 1)]
    shares = [(t / duration_s) ** 3 * (10 - 15 * t / duration_s + 6 * (t / duration_s) ** 2) for t in times]
    return JointTrajectory(
        tuple(times), tuple(tuple(a + s * (b - a) for a, b in zip(start, goal, strict=True)) for s in shares)
    )


@asynccontextmanager
async def machine(
    folder: Path, *faults: str, start: bool = True, twin: Twin | None = None
) -> AsyncIterator[Machine]:
    """Up and polling; armed and in AUTO with ``start``. ``faults`` like "relay:off@12s+3s".

    ``twin`` is that of an earlier life of the program, which goes on.
    """
    config = load_config(DEMO)
    arm_model, urdf = load_arm(config, DEMO)
    row = load_row(config, DEMO)
    rig = load_rig(packaged("configs") / config.camera.calibration)
    loop = asyncio.get_running_loop()
    twin = twin or Twin(
        nominal_machine(config, rig, urdf), Scene(seed=1, row_length_m=1.0), 1, None,
        FaultPlan(parse_fault(text) for text in faults),
    )  # fmt: skip
    async with AsyncExitStack() as stack:
        ledger = stack.enter_context(Ledger.open(folder / "ledger.sqlite", utc=lambda: START))
        ledger.begin_run("boot", START)
        task_id = ledger.begin_task(task(config, row))
        ledger.upsert_targets(task_id, [a_target(1), a_target(2)])
        troubles: list[str] = []
        devices = build_devices(config, arm_model, twin, loop.time, BuildOptions(DEMO), stack)
        await devices.open(stack, troubles.append)
        modes: list[safety.SafetyState] = []
        hands = Actuation(
            devices.arm, devices.relay, devices.wheels, devices.inputs, ledger, limits(config), hand_settings(config),
            modes.append,
        )  # fmt: skip
        hands.begin_task(task_id, 8000.0, safety.Given())
        polls = [
            asyncio.create_task(_every(period_s, step))
            for period_s, step in (
                (0.1, hands.poll_sensors), (0.05, hands.poll_odometry), (0.1, hands.poll_arm), (0.2, hands.poll_relay),
            )
        ]  # fmt: skip
        try:
            await asyncio.sleep(1.0)
            await hands.begin_metering()
            if start:
                await hands.energise(lamp=False)
                for verb in (safety.Verb.ARM, safety.Verb.START):
                    decision = hands.change_mode(verb, "test")
                    assert decision.allowed, decision.reasons
            yield Machine(twin, devices, hands, ledger, task_id, modes, polls)
        finally:
            for poll in polls:
                poll.cancel()


async def _every(period_s: float, step: Callable[[], Awaitable[None]]) -> None:
    while True:
        with suppress(DeviceError):  # the supervisor's business, which is not under test here
            await step()
        await asyncio.sleep(period_s)


def a_target(number: int) -> Target:
    return Target(
        id=number, centre_m=np.array([0.2, 0.6, 0.8]), covariance_m2=np.eye(3) * 1e-5, diameter_m=0.07,
        diameter_sigma_m=0.001, ripeness=Ripeness.RED, ripeness_score=1.0, ripeness_weight=0.9, confidence=0.9,
        visible_fraction=1.0, measured=True, sightings=1, last_seen_s=0.0, state=TargetState.OPEN, reason="",
    )  # fmt: skip
