"""A detector that fails on every frame does not let the row end as if it had been treated."""

from robot.mission import State
from robot.mission.detect import NONSENSE_MAX
from robot.safety import Mode

from .rover import spray_row

STOPS_M = (0.3, 0.5, 0.7, 0.9, 1.1)


class Failing:
    """Fails on these pairs, counted from 1, and sees what another does on the rest."""

    def __init__(self, oracle, pairs):
        self._oracle, self._pairs, self._count = oracle, pairs, 0

    def detect(self, left, right, rig):
        self._count += 1
        if self._count in self._pairs:
            raise ValueError("operands could not be broadcast together")
        return self._oracle.detect(left, right, rig)

    def detect_mono(self, image):
        return self._oracle.detect_mono(image)


def test_frame_after_frame_of_nonsense_stops_the_row_where_it_is(tmp_path):
    run = spray_row(tmp_path, stops_m=STOPS_M, eyes=lambda oracle: Failing(oracle, range(1, 100)))
    assert run.result.mode is Mode.SAFE_STOP
    assert "ValueError: operands" in run.result.causes[0]
    assert "look at camera and detector" in run.result.causes[0]
    assert [stay.state for stay in run.states].count(State.DETECT) == NONSENSE_MAX
    assert run.twin.dispensed_ml == 0.0
    assert run.twin.base_pose[0] < STOPS_M[NONSENSE_MAX]


def test_single_frames_of_nonsense_are_left_out_and_the_row_goes_on(tmp_path):
    run = spray_row(tmp_path, stops_m=STOPS_M, eyes=lambda oracle: Failing(oracle, (1, 2, 4, 5)))
    assert run.result.state is State.DONE
    assert {shot.intent.stop for shot in run.shots} == {3}
    assert len(run.troubles) == 4
