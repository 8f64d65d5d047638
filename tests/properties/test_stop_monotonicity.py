"""P14: a STOP put anywhere into any story never makes more liquid flow nor the rover go farther."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.twin import commands as c
from robot import safety
from tests.properties.system_rig import TARGETS, SystemRig

EXAMPLES = max(200, settings.default.max_examples)
WITHIN = 1e-6
COUNTERS_M = 0.001


@dataclass(frozen=True)
class Deed:
    """One thing that is done, and how long the world then waits."""

    what: str
    number: int
    amount: float
    wait_s: float


deeds = st.builds(
    Deed,
    what=st.sampled_from(["shot", "shot", "arm", "drive", "bumper", "pause", "resume", "shove", "relay fails"]),
    number=st.integers(1, TARGETS),
    amount=st.floats(0.1, 1.0),
    wait_s=st.floats(0.0, 0.8),
)


def tell(story: list[Deed], stop_before: int | None) -> tuple[float, float, dict[str, object]]:
    """Millilitres sprayed, metres rolled by the farther wheel, and what was seen broken."""
    with tempfile.TemporaryDirectory(prefix="rover-") as folder:
        rig = SystemRig(Path(folder))
        assert rig.boot()
        rig.make_ready()
        for index, deed in enumerate(story):
            if index == stop_before and rig.alive:
                rig.verb(safety.Verb.STOP)
            if rig.alive:
                do(rig, deed)
                rig.wait(deed.wait_s)
        if stop_before == len(story) and rig.alive:
            rig.verb(safety.Verb.STOP)
        rig.wait(1.5)
        rig.close()
        return rig.twin.dispensed_ml, max(map(abs, rig.court.truth.counters_m)), dict(rig.court.violations)


def do(rig: SystemRig, deed: Deed) -> None:
    assert rig.hands is not None
    match deed.what:
        case "shot":
            rig.begin(rig.hands.spray(rig.order(deed.number, deed.amount)))
        case "arm":
            rig.begin(rig.settle_arm(0.1 * deed.amount))
        case "drive":
            rig.begin(rig.hands.drive(0.3 * deed.amount, 0.0))
        case "bumper":
            rig.suffer(c.WorldBumper(deed.number == 1))
        case "pause":
            rig.verb(safety.Verb.PAUSE)
        case "resume":
            rig.verb(safety.Verb.RESUME)
        case "shove":
            rig.suffer(c.WorldPush(0.01 * deed.amount, 0.0, 0.0))
        case "relay fails":
            rig.fails("relay", "intermittent", deed.amount)


@settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
@given(story=st.lists(deeds, min_size=1, max_size=3), at=st.floats(0.0, 1.0))
def test_a_stop_anywhere_never_sprays_more_nor_drives_farther(story: list[Deed], at: float) -> None:
    without_ml, without_m, broken = tell(story, None)
    with_ml, with_m, broken_too = tell(story, round(at * len(story)))
    assert not broken
    assert not broken_too
    assert with_ml <= without_ml + WITHIN
    assert with_m <= without_m + COUNTERS_M
