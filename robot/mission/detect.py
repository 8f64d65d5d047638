"""DETECT: take a pair, find the fruit, place them in the row, and keep the book."""

from __future__ import annotations

import asyncio

from drivers.camera.values import StereoFrame
from drivers.errors import DeviceFault
from robot import navigation
from robot.clock import work
from robot.errors import SprayerError
from robot.geometry import Pose2
from robot.ledger import StopLight, StopRecord
from robot.mission.context import MissionContext
from robot.mission.events import FrameSeen, Trouble
from robot.mission.light import look, mistrust
from robot.mission.transitions import Event
from robot.targets import Book, Match, Sighting, TargetState, match, observe, sighting, wanted, with_state
from robot.vision.plausible import implausible
from robot.vision.values import Fruit

LONGEST_DETECTION_S = 60.0
NONSENSE_MAX = 3  # frames in a row
_STAMP_TOLERANCE_S = 0.2  # of a camera whose latency is not known well; the base has stood for longer than that


class VisionError(SprayerError):
    """The detector hangs, or gives nothing but nonsense."""


class LightError(SprayerError):
    """The light is not to be trusted, and the configuration says that the mission then stops."""


async def detect(context: MissionContext) -> Event:
    """One look. BASE_MOVED when odometry cannot prove that the base stood still through the exposure."""
    context.actuation.mark_frame()
    called_s = context.now_s()
    frame, light = await look(context)
    _require_fresh(frame, called_s)
    await context.actuation.poll_odometry()
    after = context.actuation.odometry
    if after is None or context.actuation.base_moved:
        return Event.BASE_MOVED
    context.localiser.on_odometry(after)
    if why := mistrust(light):
        return await _leave_in_the_dark(context, frame, light, why)
    settings = context.settings
    fruits, nonsense = await _fruits_in(context, frame)
    if nonsense:
        return await _leave_out(context, frame, light, f"the detector gave {nonsense}; this frame is dropped [F57]")
    context.progress.nonsense = 0
    pose = _correct_pose(context, fruits, frame.stamp_s)
    book, matches = observe(context.progress.book, _sightings(context, fruits, pose), frame.stamp_s, settings.book)
    await context.keep(_judged(book, context))
    context.progress.frame_pose = pose
    context.progress.seen = frozenset(item.target_id for item in matches)
    await _record(context, frame, light, fruits, matches, pose)
    return Event.TARGETS if chosen(context) else Event.NO_TARGETS


async def _fruits_in(context: MissionContext, frame: StereoFrame) -> tuple[tuple[Fruit, ...], str]:
    """What the detector sees, or why that is nonsense. ``VisionError`` when it does not come to an end."""
    detector, rig = context.detector, context.rig
    try:
        async with asyncio.timeout(LONGEST_DETECTION_S):
            fruits = await work(
                lambda: detector.detect(frame.left, frame.right, rig), context.settings.detect_duration_s
            )
    except TimeoutError:
        raise VisionError(
            f"the detector did not come to an end within {LONGEST_DETECTION_S:g} s; choose a faster one, then resume"
        ) from None
    except Exception as error:  # noqa: BLE001 - whatever a detector trips over, its frame is worth nothing
        return (), f"an error ({type(error).__name__}: {error})"
    return fruits, implausible(fruits, rig.image_size)


async def _leave_out(context: MissionContext, frame: StereoFrame, light: StopLight, why: str) -> Event:
    """Nothing is looked for in such a frame, so nothing is sprayed at this stop; it is told and written down.

    ``VisionError`` when frame after frame is so: the row would end as done with nothing sprayed.
    """
    text = await _tell_left_out(context, frame, light, why, "vision")
    context.progress.nonsense += 1
    if context.progress.nonsense >= NONSENSE_MAX:
        context.progress.nonsense = 0  # who resumes has looked
        raise VisionError(f"{text}; so were the {NONSENSE_MAX - 1} before it: look at camera and detector, then resume")
    context.publish(Trouble(text, context.now_s()))
    return Event.NO_TARGETS


async def _leave_in_the_dark(context: MissionContext, frame: StereoFrame, light: StopLight, why: str) -> Event:
    """As ``_leave_out``; or the mission stops, when the configuration says so."""
    text = await _tell_left_out(context, frame, light, why, "light")
    if context.settings.light.stops_when_dark:
        raise LightError(f"{text}; come back by day or light the lamp, then resume")
    context.publish(Trouble(text, context.now_s()))
    return Event.NO_TARGETS


async def _tell_left_out(
    context: MissionContext, frame: StereoFrame, light: StopLight, why: str, kind: str
) -> str:
    pose = context.localiser.pose_at(frame.stamp_s)
    context.progress.frame_pose, context.progress.seen = pose, frozenset()
    await _record(context, frame, light, (), (), pose)
    text = f"stop {context.progress.stop}: {why}"
    await context.record(kind, text)
    return text


def _require_fresh(frame: StereoFrame, called_s: float) -> None:
    """``DeviceFault`` for a pair whose exposure began before it was asked for: nobody knows where the base was then."""
    begun_s = frame.stamp_s - 0.5 * frame.exposure_s
    if not begun_s >= called_s - _STAMP_TOLERANCE_S:
        raise DeviceFault(
            "camera", "a pair exposed after it was asked for", f"one that began {called_s - begun_s:.2f} s before",
            "look for what holds its pictures up (computer, cable, hub)",
        )  # fmt: skip


def chosen(context: MissionContext) -> tuple[int, ...]:
    """Wanted targets of this frame that are not too far ahead: those are left to the next stop."""
    stops = context.settings.row.stops
    last = context.progress.stop >= len(stops)
    limit_m = float("inf") if last else context.stop_here().x_m + context.settings.ahead_m
    return tuple(
        target.id
        for target in context.progress.book.pending()
        if target.id in context.progress.seen
        and wanted(target, context.settings.policy).wanted
        and float(target.centre_m[0]) <= limit_m
    )


def _sightings(context: MissionContext, fruits: tuple[Fruit, ...], pose: Pose2) -> tuple[Sighting, ...]:
    row_from_camera = pose.transform() @ context.settings.base_from_camera
    return tuple(sighting(fruit, row_from_camera) for fruit in fruits)


def _correct_pose(context: MissionContext, fruits: tuple[Fruit, ...], stamp_s: float) -> Pose2:
    """The pose at the frame, corrected by the fruits that the book knows already."""
    pose = context.localiser.pose_at(stamp_s)
    if not context.settings.landmarks:
        return pose
    known = match(context.progress.book, _sightings(context, fruits, pose), context.settings.book)
    shift = navigation.estimate_shift([item.offset_m for item in known])
    if shift is None:
        return pose
    context.localiser.on_landmarks(pose, shift, stamp_s)
    return context.localiser.pose_at(stamp_s)


def _judged(book: Book, context: MissionContext) -> Book:
    """Apply the policy to what may still be sprayed; a later look may change its word.

    A target with thin evidence stays open, with the reason, until the row is done.
    """
    for target in book.in_state(TargetState.OPEN, TargetState.NOT_WANTED):
        verdict = wanted(target, context.settings.policy)
        state = TargetState.NOT_WANTED if verdict.state is TargetState.NOT_WANTED else TargetState.OPEN
        if (state, verdict.reason) != (target.state, target.reason):
            book = with_state(book, target.id, state, verdict.reason)
    return book


def frame_file(stop: int) -> str:
    """Under which name the annotated frame of a stop is kept."""
    return f"stop_{stop:03d}.jpg"


async def _record(
    context: MissionContext, frame: StereoFrame, light: StopLight, fruits: tuple[Fruit, ...],
    matches: tuple[Match, ...], pose: Pose2,
) -> None:  # fmt: skip
    stop = context.progress.stop
    ids = {item.index: item.target_id for item in matches}
    context.publish(FrameSeen(stop, frame, fruits, tuple(ids.get(i, 0) for i in range(len(fruits)))))
    record = StopRecord(
        row=context.settings.row.name,
        stop=stop,
        planned_x_m=context.stop_here().x_m,
        x_m=pose.x_m,
        y_m=pose.y_m,
        heading_rad=pose.heading_rad,
        stamp_s=frame.stamp_s,
        frame_file=frame_file(stop),
        light_level=float(frame.left.mean()),
        fruits_seen=len(fruits),
        light=light,
    )
    await context.write(lambda: context.ledger.record_stop(context.task_id, record))
