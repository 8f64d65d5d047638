"""Operators, shots, faults, kills and time in any order: no property that can be seen from outside is ever broken."""

from __future__ import annotations

import tempfile
from pathlib import Path

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from drivers.twin import commands as c
from drivers.twin.faults import DEVICES, VALVE_VERBS, Verb
from robot import safety
from tests.properties.system_rig import TARGETS, SystemRig

EXAMPLES = max(200, settings.default.max_examples)
LATCHED = (safety.Mode.SAFE_STOP, safety.Mode.ESTOP)
seconds = st.floats(0.01, 1.0)
shares = st.floats(-1.0, 1.0)
device_faults = st.sampled_from(
    [(device, verb) for device in DEVICES for verb in (VALVE_VERBS if device == "valve" else Verb) if verb != Verb.OK]
)  # fmt: skip


class RoverInTrouble(RuleBasedStateMachine):
    """The mock rover, its operator and the world around them, in virtual time; the monitors judge after every step."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory(prefix="rover-")
        self.rig = SystemRig(Path(self._folder.name))

    def teardown(self) -> None:
        try:
            self.rig.close()
            assert not self.rig.court.violations, self.rig.story
        finally:
            self._folder.cleanup()

    @property
    def up(self) -> bool:
        return self.rig.alive

    @property
    def mode(self) -> safety.Mode:
        assert self.rig.hands is not None
        return self.rig.hands.state.mode

    @invariant()
    def no_property_is_broken(self) -> None:
        assert not self.rig.court.violations, self.rig.story

    @initialize(ready=st.booleans())
    def it_comes_up(self, ready: bool) -> None:
        assert self.rig.boot()
        if ready:
            self.rig.make_ready()

    # --- time and the process

    @rule(for_s=seconds)
    def time_goes_by(self, for_s: float) -> None:
        self.rig.wait(for_s)

    @rule(step_s=st.floats(-1e7, 1e7))
    def the_wall_clock_jumps(self, step_s: float) -> None:
        self.rig.wall.step(step_s)

    @precondition(lambda self: self.up)
    @rule()
    def the_process_is_killed(self) -> None:
        self.rig.kill()

    @precondition(lambda self: self.up)
    @rule()
    def the_process_is_told_to_end(self) -> None:
        self.rig.shut_down()

    @precondition(lambda self: not self.up)
    @rule()
    def it_is_started_again(self) -> None:
        if self.rig.boot():
            assert self.mode in (safety.Mode.DISARMED, *LATCHED)

    # --- the operator

    @precondition(lambda self: self.up)
    @rule(verb=st.sampled_from(safety.Verb), twice=st.booleans())
    def a_verb_is_said(self, verb: safety.Verb, twice: bool) -> None:
        self.rig.verb(verb)
        if not self.up:
            return
        once = self.mode
        if verb is safety.Verb.ESTOP:
            assert once is safety.Mode.ESTOP
        elif verb is safety.Verb.STOP:
            assert once in LATCHED
        if twice and self.up:
            self.rig.verb(verb)
            if self.up and verb is not safety.Verb.STOP:  # the e-stop's poll may come in between
                assert self.mode in (once, *LATCHED), f"P12: {verb} said twice led from {once} to {self.mode}"

    @precondition(lambda self: self.up and self.mode in (safety.Mode.DISARMED, safety.Mode.READY))
    @rule()
    def it_is_made_ready(self) -> None:
        self.rig.make_ready()

    @precondition(lambda self: self.up and self.mode in LATCHED)
    @rule()
    def it_is_acknowledged_and_made_ready(self) -> None:
        self.rig.suffer(c.WorldEstop(False))
        self.rig.suffer(c.WorldBumper(False))
        self.rig.wait(0.3)
        if not self.up:
            return
        for verb in (safety.Verb.ACKNOWLEDGE, safety.Verb.RESET):
            self.rig.verb(verb)
        self.rig.make_ready()

    # --- what is asked of the hands

    @precondition(lambda self: self.up)
    @rule(fruit=st.integers(1, TARGETS), open_s=st.floats(0.08, 1.1), for_s=seconds)
    def a_shot_is_asked_for(self, fruit: int, open_s: float, for_s: float) -> None:
        assert self.rig.hands is not None
        self.rig.begin(self.rig.hands.spray(self.rig.order(fruit, open_s)))
        self.rig.wait(0.4 * for_s)

    @precondition(lambda self: self.up)
    @rule(by=shares)
    def the_arm_is_asked_to_move(self, by: float) -> None:
        self.rig.begin(self.rig.settle_arm(0.2 * by))

    @precondition(lambda self: self.up)
    @rule(speed=shares, turn=shares)
    def the_base_is_asked_to_drive(self, speed: float, turn: float) -> None:
        assert self.rig.hands is not None
        self.rig.begin(self.rig.hands.drive(0.5 * speed, 0.5 * turn))

    @precondition(lambda self: self.up)
    @rule()
    def who_waits_gives_up(self) -> None:
        self.rig.cancel_all()

    # --- the world

    @rule(pressed=st.booleans())
    def the_estop(self, pressed: bool) -> None:
        self.rig.suffer(c.WorldEstop(pressed))

    @rule(pressed=st.booleans())
    def the_bumper(self, pressed: bool) -> None:
        self.rig.suffer(c.WorldBumper(pressed))

    @rule(x=shares, turn=shares)
    def a_shove(self, x: float, turn: float) -> None:
        self.rig.suffer(c.WorldPush(0.4 * x, 0.02 * turn, 0.05 * turn))

    @rule(fault=device_faults, for_s=st.floats(0.02, 4.0))
    def a_fault(self, fault: tuple[str, Verb], for_s: float) -> None:
        self.rig.fails(*fault, for_s)

    @rule(joint=st.integers(0, 5), error=st.sampled_from([0x00, 0x04, 0x20]))
    def a_servo(self, joint: int, error: int) -> None:
        self.rig.suffer(c.WorldServoError(joint, error))

    @rule(ml=st.floats(0.0, 9000.0))
    def the_tank(self, ml: float) -> None:
        self.rig.suffer(c.WorldRefill(ml))


TestRoverInTrouble = RoverInTrouble.TestCase
TestRoverInTrouble.settings = settings(
    max_examples=EXAMPLES, stateful_step_count=8, deadline=None, suppress_health_check=list(HealthCheck),
    phases=(Phase.explicit, Phase.reuse, Phase.generate),  # shrinking runs for minutes; the monitors tell the story
)
