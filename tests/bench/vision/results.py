"""Everything that was measured, and the same as plain numbers for bench.json."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from robot.vision.values import Circle, Fruit
from tests.bench.vision.contestants import CONTESTANTS, Key, make
from tests.bench.vision.groups import GROUPINGS, grouped
from tests.bench.vision.labelled import PhotoSet, SceneFacts, StereoSet, TrueFruit
from tests.bench.vision.photo_scoring import JudgedPhoto, PhotoScore, judge_photo, photo_score, recall_by_group
from tests.bench.vision.scoring import Judged, judge, statistics_of, together
from tests.bench.vision.throughput import Throughput
from tests.bench.vision.timing import PairTime

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What a contestant found in a scene, and what there is."""

    scene: SceneFacts
    truths: tuple[TrueFruit, ...]
    found: tuple[Fruit, ...]


@dataclass(frozen=True, slots=True)
class StereoResult:
    """A set of scenes seen by every contestant."""

    pictures: StereoSet
    seen: dict[Key, tuple[Seen, ...]]

    def judged(self, key: Key, kinds: Collection[str] | None = None) -> Judged:
        """All scenes; ``kinds`` restricts what is eligible to some ripeness."""
        return together(judge(seen.scene, seen.truths, seen.found, kinds=kinds) for seen in self.seen[key])


@dataclass(frozen=True, slots=True)
class PhotoResult:
    """A set of photographs seen by every contestant."""

    pictures: PhotoSet
    judged: dict[Key, tuple[JudgedPhoto, ...]]

    def score(self, key: Key) -> PhotoScore:
        return photo_score(self.judged[key])


@dataclass(frozen=True, slots=True)
class Results:
    """``rendered``, ``photos`` and ``throughput`` are None when their pictures are not there (``absent`` says why).

    ``singles`` by distance in metres.
    """

    rendered: StereoResult | None
    photos: PhotoResult | None
    rows: StereoResult
    singles: dict[float, StereoResult]
    times: tuple[PairTime, ...]
    throughput: Throughput | None
    absent: tuple[str, ...]

    @property
    def stereo(self) -> tuple[StereoResult, ...]:
        return (*([self.rendered] if self.rendered is not None else []), self.rows, *self.singles.values())


def look_at_scenes(pictures: StereoSet, tell: Tell) -> StereoResult:
    """Every contestant on every scene."""
    detectors = {contestant.key: make(contestant.key) for contestant in CONTESTANTS}
    seen: dict[Key, list[Seen]] = {key: [] for key in detectors}
    for name in pictures.names:
        scene = pictures.load(name)
        for key, detector in detectors.items():
            seen[key].append(Seen(scene.facts, scene.fruits, detector.detect(scene.left, scene.right, scene.rig)))
    result = StereoResult(pictures, {key: tuple(every) for key, every in seen.items()})
    for contestant in CONTESTANTS:
        judged = result.judged(contestant.key)
        all_of = statistics_of(judged.sightings)
        tell(
            f"{pictures.title}: {contestant.key:<13} recognition {_text(all_of.recognition, 3)} of {all_of.eligible}, "
            f"precision {_text(judged.precision, 3)}, 3-D error {_text(all_of.error_median_mm, 2)} / "
            f"{_text(all_of.error_p95_mm, 1)} mm, depth bias {_text(all_of.depth_bias_mm, 2)} mm, "
            f"diameter {_text(all_of.diameter_error_median_percent, 2)} %"
        )
    return result


def look_at_photos(pictures: PhotoSet, tell: Tell) -> PhotoResult:
    """Every contestant on every photograph."""
    detectors = {contestant.key: make(contestant.key) for contestant in CONTESTANTS}
    judged: dict[Key, list[JudgedPhoto]] = {key: [] for key in detectors}
    for name in pictures.names:
        photo = pictures.load(name)
        for key, detector in detectors.items():
            circles: tuple[Circle, ...] = detector.detect_mono(photo.image)
            judged[key].append(judge_photo(photo, circles))
    result = PhotoResult(pictures, {key: tuple(every) for key, every in judged.items()})
    for key in detectors:
        score = result.score(key)
        tell(
            f"{pictures.title}: {key:<13} recall {score.recall:.3f}, precision {score.precision:.3f}, "
            f"F1 {score.f1:.3f}, AP50 {score.ap50:.3f}"
        )
    return result


def numbers(results: Results) -> dict[str, Any]:
    """Nested dictionaries with numbers (or None) for leaves."""
    out: dict[str, Any] = {"scenes": {one.pictures.key: _stereo_numbers(one) for one in results.stereo}}
    if results.photos is not None:
        photos = results.photos
        out["photos"] = {
            key: {**asdict(photos.score(key)), "recall_by": _recalls(judged)} for key, judged in photos.judged.items()
        }
    out["milliseconds"] = {
        f"{row.pictures}, {row.size}, {row.contestant}": {
            stage.stage: {"median": stage.median_ms, "least": stage.least_ms} for stage in row.stages
        }
        for row in results.times
    }
    if results.throughput is not None:
        out["sprayer_detect"] = asdict(results.throughput)
    return out


def _stereo_numbers(result: StereoResult) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key in result.seen:
        judged = result.judged(key)
        out[key] = {
            "scenes": len(result.pictures.names),
            "detections": len(judged.detections),
            "precision": judged.precision,
            **asdict(statistics_of(judged.sightings)),
            "by": {
                grouping.key: {
                    group.name: {
                        "detections": group.detections,
                        "precision": group.precision,
                        **asdict(group.statistics),
                    }
                    for group in grouped(judged, grouping)
                }
                for grouping in GROUPINGS
            },
        }
    return out


def _recalls(judged: Sequence[JudgedPhoto]) -> dict[str, dict[str, dict[str, float]]]:
    return {
        grouping: {name: {"boxes": count, "recall": hits / count} for name, (hits, count) in rows.items()}
        for grouping, rows in recall_by_group(judged).items()
    }


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
