"""Operators, faults, readings and time in any order against the reducer of ``robot.safety``.

P-numbers are those of the properties that the rover must hold: what safety allows is compared with what was reported,
read and asked for, kept here in plain words and sums.
"""

import math
from collections import Counter
from dataclasses import replace

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robot.safety import (
    CATALOGUE,
    Action,
    Clear,
    Given,
    Mode,
    MotionRequest,
    SafetyState,
    SprayRequest,
    Verb,
    authorise_motion,
    authorise_spray,
    beat_lease,
    change_mode,
    clear_fault,
    report_fault,
    settle_booking,
    still_allowed,
    take_lease,
    watch,
)
from tests.robot.safety.test_envelope import GOOD, LIMITS

KINDS = {kind.id: kind for kind in CATALOGUE}
READERS = ("sensors_s", "odometry_s", "arm_s", "relay_s")
CELLS = [(0, 0), (1, 0)]
PASSING = sorted(kind.id for kind in CATALOGUE if kind.action < Action.PAUSE)
READINGS = [
    {"estop_pressed": True}, {"bumper_pressed": True}, {"tilt_rad": 0.3}, {"tilt_rad": 0.5}, {"pressure_bar": 1.0},
    {"base_speed_m_s": 0.2}, {"base_commanded": True}, {"moved_since_frame_m": 0.01}, {"arm_settled": False},
    {"arm_stowed": False}, {"arm_healthy": False}, {"valve_coil": True}, {"tank_left_ml": 202.0},
    {"battery_v": 22.0}, {"battery_v": 20.0}, {"fence_margin_m": -0.2}, {"moved_since_pause_m": 0.5},
    {"pump_coil": True},
]  # fmt: skip
GUARDED = replace(LIMITS, battery_low_v=22.8, battery_stop_v=21.6)
REACHED: Counter[str] = Counter()
HOLDERS = st.sampled_from(["tablet", "phone"])


class SafetyMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.now_s = 1000.0
        self.ages_s = dict.fromkeys(READERS, 0.0)
        self.change: dict[str, object] = {}
        self.state = SafetyState(given=Given(900.0, 1900.0, ((1, 12.0),), ((CELLS[0], 30.0),)))

    @property
    def inputs(self):
        return replace(GOOD, **self.change, **{name: self.now_s - age for name, age in self.ages_s.items()})

    # --- what happens -----------------------------------------------------------------------------------------

    @initialize(verb=st.sampled_from([Verb.START, Verb.START, Verb.OPERATE]))
    def it_begins_with_a_machine_that_is_up(self, verb):
        self.the_machine_is_brought_up(verb)

    @rule(verb=st.sampled_from([Verb.START, Verb.START, Verb.OPERATE]))
    def the_machine_is_brought_up(self, verb):
        """As a person would: all well, faults acknowledged, armed, started."""
        self.ages_s, self.change = dict.fromkeys(self.ages_s, 0.0), {}
        for fault in self.state.faults:
            self.state = clear_fault(self.state, fault.id)
        for step in (Verb.RESET, Verb.ACKNOWLEDGE, Verb.DISARM, Verb.ACKNOWLEDGE, Verb.ARM, verb):
            self.state, _ = change_mode(self.state, step, "", self.inputs, self.now_s)
        self.state, _ = take_lease(self.state, "tablet", self.now_s, take_over=True)
        assert self.state.mode is (Mode.AUTO if verb is Verb.START else Mode.MANUAL)

    @rule(seconds=st.sampled_from([0.05, 0.05, 0.05, 0.3, 0.6, 6.0, 61.0]))
    def time_passes(self, seconds):
        self.now_s += seconds

    @rule(name=st.sampled_from(READERS), age_s=st.sampled_from([0.0, 0.0, 0.0, 2.0]))
    def a_reading_ages(self, name, age_s):
        self.ages_s[name] = age_s

    @rule(change=st.sampled_from([*len(READINGS) * [{}], *READINGS]))
    def readings_change(self, change):
        self.change = change

    @rule()
    def readings_are_watched(self):
        before = self.state
        self.state = watch(before, self.inputs, GUARDED, self.now_s)
        self.no_step_towards_motion(before)

    @rule(fault_id=st.sampled_from([*sorted(KINDS), *3 * PASSING]))
    def a_fault_is_reported(self, fault_id):
        before = self.state
        self.state = report_fault(before, fault_id, "reported", self.now_s)
        self.no_step_towards_motion(before)
        if KINDS[fault_id].action >= Action.SAFE_STOP and fault_id not in {f.id for f in before.faults}:
            assert self.state.mode in (Mode.SAFE_STOP, Mode.ESTOP, Mode.DISARMED)

    @rule(fault_id=st.sampled_from(sorted(KINDS)))
    def the_cause_of_a_fault_goes(self, fault_id):
        before = self.state
        self.state = clear_fault(before, fault_id)
        assert self.state.mode is before.mode
        gone = {f.id for f in before.faults} - {f.id for f in self.state.faults}
        assert gone <= {fault_id}
        if gone and before.mode is not Mode.DISARMED:  # P16
            assert KINDS[fault_id].clears is Clear.GONE

    @rule(verb=st.sampled_from([*Verb, Verb.ACKNOWLEDGE, Verb.RESUME, Verb.RESUME_SELF, Verb.ARM, Verb.START]))
    def an_operator_asks(self, verb):
        before = self.state
        self.state, decision = change_mode(before, verb, "asked", self.inputs, self.now_s)
        assert decision.allowed or self.state is before
        if verb in (Verb.STOP, Verb.ESTOP):
            assert decision.allowed
            assert self.state.mode in (Mode.SAFE_STOP, Mode.ESTOP)
        if verb is Verb.RESET and decision.allowed:  # P7, P8
            assert not self.inputs.estop_pressed
            assert self.state.mode is Mode.DISARMED
        if verb is Verb.ARM and before.mode is Mode.DISARMED:  # P19
            assert decision.allowed == (self.fresh and self.well and not self.inputs.pump_coil)
        if verb is Verb.RESUME_SELF and decision.allowed:  # P17
            assert self.inputs.moved_since_pause_m <= 0.2
            assert "asked" not in before.causes
        if self.state.mode in (Mode.AUTO, Mode.MANUAL) and self.state.mode is not before.mode:
            assert self.fresh
            assert self.well

    @rule(holder=HOLDERS, take_over=st.booleans())
    def somebody_takes_the_controls(self, holder, take_over):
        before = self.state.lease
        self.state, decision = take_lease(self.state, holder, self.now_s, take_over)
        assert decision.allowed == (
            before is None or before.holder == holder or take_over or self.now_s - before.beat_s > 5.0
        )
        assert self.state.lease.holder == (holder if decision.allowed else before.holder)

    @rule(holder=HOLDERS)
    def somebody_gives_a_sign_of_life(self, holder):
        before = self.state
        self.state, decision = beat_lease(before, holder, self.now_s)
        assert decision.allowed == (before.lease is not None and before.lease.holder == holder)

    @rule(
        fruit=st.integers(1, 3), ml=st.sampled_from([0.5, 3.0, 12.0, 40.0]), factor=st.sampled_from([1.0, 1.5]),
        cell=st.sampled_from([None, *CELLS]),
    )  # fmt: skip
    def a_shot_is_asked_for(self, fruit, ml, factor, cell):
        before = self.state
        request = SprayRequest(fruit, ml, factor * ml, 0.3, 0.4, cell)
        self.state, decision = authorise_spray(before, self.inputs, request, GUARDED, self.now_s)
        if not decision.allowed:
            assert self.state is before
            return
        REACHED["shots"] += 1
        self.may_act(Action.INHIBIT_SPRAY)
        inputs = self.inputs
        assert inputs.arm_settled  # P5
        assert inputs.moved_since_frame_m <= 0.005
        assert abs(inputs.base_speed_m_s) <= 0.01  # P4
        assert not inputs.base_commanded
        assert not inputs.valve_coil
        assert not any(booking.pending for booking in before.bookings)

    @precondition(lambda self: any(booking.pending for booking in self.state.bookings))
    @rule(share=st.sampled_from([0.0, 0.6, 1.0]))
    def a_shot_is_booked(self, share):
        (booking,) = (b for b in self.state.bookings if b.pending)
        self.state = settle_booking(self.state, booking.target_id, share * booking.ml, self.now_s)

    @rule(part=st.sampled_from(["base", "arm"]), speed=st.sampled_from([-0.2, 0.05, 0.3, 0.31, math.nan]))
    def a_motion_is_asked_for(self, part, speed):
        request = MotionRequest(part, speed if part == "base" else 0.0)
        decision = authorise_motion(self.state, self.inputs, request, GUARDED, self.now_s)
        if decision.allowed:
            REACHED["motions"] += 1
            self.may_act(Action.PAUSE)
            assert not self.inputs.valve_coil
            assert not any(booking.pending for booking in self.state.bookings)
            if part == "base":
                assert abs(speed) <= GUARDED.max_base_speed_m_s
                assert self.inputs.arm_stowed
                drives_back = self.state.mode is Mode.MANUAL and abs(speed) <= 0.1
                assert self.inputs.fence_margin_m >= 0.0 or drives_back  # P26

    # --- what holds at any time -------------------------------------------------------------------------------

    @invariant()
    def every_sum_is_below_its_cap(self):  # P11, what is pending included
        given, bookings = self.state.given, self.state.bookings
        run_ml = sum(b.ml for b in bookings)
        assert given.task_ml + run_ml <= GUARDED.max_task_ml + 1e-6
        assert given.day_ml + run_ml <= GUARDED.max_day_ml + 1e-6
        for target in (1, 2, 3):
            target_ml = dict(given.target_ml).get(target, 0.0) + sum(b.ml for b in bookings if b.target_id == target)
            assert target_ml <= GUARDED.max_target_ml + 1e-6
        for cell in CELLS:
            cell_ml = dict(given.cell_ml).get(cell, 0.0) + sum(b.ml for b in bookings if b.cell == cell)
            assert cell_ml <= GUARDED.max_cell_ml + 1e-6
        for end in bookings:
            minute_ml = sum(b.ml for b in bookings if end.stamp_s - 60.0 < b.stamp_s <= end.stamp_s)
            assert minute_ml <= GUARDED.max_minute_ml + 1e-6

    @invariant()
    def a_stop_always_works(self):  # P13, P14
        after, decision = change_mode(self.state, Verb.STOP, "stop", None, self.now_s)
        assert decision.allowed
        request = SprayRequest(2, 0.5, 0.5, 0.3, 0.4)
        assert not authorise_spray(after, self.inputs, request, GUARDED, self.now_s)[1].allowed
        assert not authorise_motion(after, self.inputs, MotionRequest("arm"), GUARDED, self.now_s).allowed
        assert not still_allowed(after, self.inputs, self.now_s).allowed

    @invariant()
    def a_latched_or_paused_machine_says_why(self):
        assert bool(self.state.causes) == (self.state.mode in (Mode.PAUSED, Mode.SAFE_STOP, Mode.ESTOP))

    # --- helpers ----------------------------------------------------------------------------------------------

    @property
    def fresh(self):
        limits_s = {"sensors_s": 0.5, "odometry_s": 0.3, "arm_s": 0.3, "relay_s": 1.0}
        return all(age <= limits_s[name] for name, age in self.ages_s.items())

    @property
    def well(self):
        inputs = self.inputs
        standing = any(KINDS[fault.id].action >= Action.PAUSE for fault in self.state.faults)
        return not (
            standing or inputs.estop_pressed or inputs.bumper_pressed or inputs.tilt_rad > 0.26
            or not inputs.arm_healthy or inputs.valve_coil
        )  # fmt: skip

    def may_act(self, least):
        """What is common to everything that moves or sprays."""
        state, inputs = self.state, self.inputs
        assert state.mode in (Mode.AUTO, Mode.MANUAL)  # P6, P18
        assert self.fresh
        assert not inputs.estop_pressed
        assert not inputs.bumper_pressed
        assert inputs.tilt_rad <= 0.26
        assert inputs.arm_healthy
        assert all(KINDS[fault.id].action < least for fault in state.faults)  # P15
        if state.mode is Mode.MANUAL:  # P20
            assert state.lease is not None
            assert self.now_s - state.lease.beat_s <= 0.5

    def no_step_towards_motion(self, before):
        """A fault never arms, starts or resumes anything."""
        severity = [Mode.AUTO, Mode.MANUAL, Mode.READY, Mode.PAUSED, Mode.DISARMED, Mode.SAFE_STOP, Mode.ESTOP]
        if self.state.mode is not before.mode:
            assert severity.index(self.state.mode) > severity.index(before.mode)


TestSafety = SafetyMachine.TestCase
TestSafety.settings = settings(
    max_examples=max(200, settings.default.max_examples), stateful_step_count=60, deadline=None
)


def test_the_machine_above_came_to_shots_and_motions():
    assert REACHED["shots"] > 50
    assert REACHED["motions"] > 50
