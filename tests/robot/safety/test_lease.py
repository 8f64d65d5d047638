import pytest

from robot.safety import Lease, SafetyState, beat_lease, holder_reasons, release_lease, take_lease

HELD = SafetyState(lease=Lease("tablet", 10.0, 20.0))


def test_a_free_lease_is_taken_and_taken_again_by_its_holder():
    state, decision = take_lease(SafetyState(), "tablet", 10.0)
    assert decision.allowed
    assert state.lease == Lease("tablet", 10.0, 10.0)
    state, decision = take_lease(state, "tablet", 12.0)
    assert decision.allowed
    assert state.lease == Lease("tablet", 10.0, 12.0)


def test_a_second_operator_does_not_get_it_but_by_an_explicit_takeover_or_after_silence():
    state, decision = take_lease(HELD, "phone", 25.0)
    assert state is HELD
    assert decision.reasons == ("'tablet' holds the controls; take over explicitly, or wait",)
    for now_s, take_over in ((20.0, True), (25.01, False)):
        state, decision = take_lease(HELD, "phone", now_s, take_over)
        assert decision.allowed
        assert state.lease == Lease("phone", now_s, now_s)


def test_only_the_holder_keeps_it_alive_or_gives_it_back():
    state, decision = beat_lease(HELD, "tablet", 21.0)
    assert decision.allowed
    assert state.lease == Lease("tablet", 10.0, 21.0)
    for state, words in ((HELD, "'tablet' holds the controls"), (SafetyState(), "nobody holds the controls")):
        same, decision = beat_lease(state, "phone", 21.0)
        assert same is state
        assert words in decision.reasons[0]
        assert release_lease(state, "phone") is state
    assert release_lease(HELD, "tablet").lease is None


@pytest.mark.parametrize(
    ("state", "holder", "reasons"),
    [
        (HELD, "tablet", ()),
        (HELD, "phone", ("'tablet' holds the controls",)),
        (SafetyState(), "phone", ("nobody holds the controls; take them first",)),
    ],
)
def test_who_may_move_the_machine_by_hand(state, holder, reasons):
    assert holder_reasons(state, holder) == reasons
