import itertools
import re
from collections import Counter

import pytest

from robot.safety import CATALOGUE, Action, Clear, fault_of, most_severe
from robot.safety.failsafe import TASK_FAULTS, kind_of


def test_the_catalogue_has_every_number_once():
    counts = Counter(kind.id for kind in CATALOGUE)
    wanted = {f"F{n:02d}" for n in range(1, 70)} | {f"F70{letter}" for letter in "abcdefghijklmn"} | {"F20b", "F69b"}
    assert set(counts) == wanted
    assert set(counts.values()) == {1}


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.id)
def test_every_row_says_what_when_and_what_is_kept(kind):
    assert re.fullmatch(r"F\d\d[a-n]?", kind.id)
    assert kind.title
    assert kind.detected_by
    assert kind.kept
    assert 0.0 < kind.within_s <= 300.0


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.id)
def test_what_stops_for_good_needs_a_person_and_what_passes_stops_nothing(kind):
    if kind.action >= Action.SAFE_STOP:
        assert kind.clears in (Clear.ACKNOWLEDGED, Clear.RESET, Clear.RESTARTED)
    if kind.clears is Clear.PASSED:
        assert kind.action is Action.WARN
    assert (kind.clears is Clear.RESET) == (kind.action is Action.ESTOP)


def test_the_most_severe_fault_wins_and_one_more_never_lowers_it():
    assert most_severe(()) is Action.WARN
    ids = [next(kind.id for kind in CATALOGUE if kind.action is action) for action in Action]
    for count in range(1, len(ids) + 1):
        for faults in itertools.combinations(ids, count):
            assert most_severe(faults) == max(kind_of(fault).action for fault in faults)
            for more in ids:
                assert most_severe((*faults, more)) >= most_severe(faults)


def test_what_moves_or_sprays_stops_the_machine_when_it_fails_and_what_only_tells_does_not():
    assert {name for name in TASK_FAULTS if most_severe([fault_of(name)]) is Action.SAFE_STOP} == {
        "sensors", "inputs", "odometry", "wheels", "arm", "relay", "camera",
    }  # fmt: skip
    assert {name for name in TASK_FAULTS if most_severe([fault_of(name)]) is Action.WARN} == {"gps", "modem"}


def test_a_task_that_nobody_foresaw_stops_the_machine():
    assert fault_of("something new") == "F34"
    assert kind_of("F34").action is Action.SAFE_STOP


def test_a_fault_that_is_not_in_the_catalogue_is_an_error():
    with pytest.raises(KeyError, match="no fault 'F99' in the catalogue; it has F01, F02"):
        kind_of("F99")
