"""What became of a machine whose robot died: its truth file replayed, the physics run on until all is at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.relay.values import Channel
from drivers.twin.codec import decode, encode
from drivers.twin.deviations import TrueMachine
from drivers.twin.faults import FaultPlan, parse_fault
from drivers.twin.machine import Twin
from drivers.twin.nominal import Nominal
from drivers.twin.scene import Scene
from drivers.twin.truth import TruthList, TruthLog
from drivers.twin.truth_record import Event, ProcessTruth, TruthRecord, event_of, read_truth

RUN_ON_STEP_S = 0.5
SETTLE_S = 30.0  # beyond the longest pulse; only a machine with a standing fault does not rest by then


@dataclass(frozen=True, slots=True)
class Aftermath:
    """The last process of a truth file, judged. Times in its clock.

    ``last_s`` is its last line, ``at_rest_s`` when nothing moved or flowed any more. ``valve_shut_s`` is when the valve
    shut for the last time (None: it never opened); ``longest_opening_s`` its longest stay open in any process.
    ``total_ml`` left the nozzle in all processes together, ``after_ml`` of it after the last line.
    ``coils`` and ``base_pose`` are as they stay.
    """

    last_s: float
    at_rest_s: float
    valve_open_at_last: bool
    valve_shut_s: float | None
    longest_opening_s: float
    total_ml: float
    after_ml: float
    fruit_ml: Mapping[int, float]
    coils: Mapping[Channel, bool]
    base_pose: tuple[float, float, float]
    events: tuple[Event, ...]


def run_on(path: Path) -> Aftermath:
    """Judge a run from its truth file alone. Raises ``ValueError`` when it is not one."""
    record = read_truth(path)
    twin, sinks = _replay(record)
    last = record.processes[-1]
    open_at_last, before_ml = twin.valve_open, twin.dispensed_ml
    _rest(twin)
    events = [tuple(event_of(line) for line in _events(sink)) for sink in sinks]
    closings = [event.t for event in events[-1] if event.what == "valve_closed"]
    openings = [event.detail["open_s"] for told in events for event in told if event.what == "delivered"]
    return Aftermath(
        last_s=last.last_t,
        at_rest_s=twin.now_s,
        valve_open_at_last=open_at_last,
        valve_shut_s=closings[-1] if closings else None,
        longest_opening_s=max(openings, default=0.0),
        total_ml=twin.dispensed_ml,
        after_ml=twin.dispensed_ml - before_ml,
        fruit_ml=twin.fruit_ml,
        coils=dict(twin.physics.board.contacts),
        base_pose=twin.base_pose,
        events=events[-1],
    )


def resume_from(path: Path, nominal: Nominal, scene: Scene, seed: int, faults: FaultPlan | None = None) -> Twin:
    """The machine as the processes before left it, its clock at 0; a new machine when the file is new or empty.

    What happened after the last process died is appended to its part of the file first.
    Raises ``ValueError`` when the file tells of another machine, ``BlockingIOError`` while another process writes it.
    """
    log = TruthLog(path)
    try:
        if path.stat().st_size == 0:
            return Twin(nominal, scene, seed, log, faults)
        record = read_truth(path)
        world = record.processes[0].world
        same = world["seed"] == seed and world["scene"] == encode(scene) and world["nominal"] == encode(nominal)
        if not same:
            raise ValueError(
                f"truth file {path}: expected the machine, scene and seed of this run, found others; name another file"
            )
        twin, sinks = _replay(record)
        _rest(twin)
        for event in _events(sinks[-1])[len(record.processes[-1].events) :]:
            log.append(event)
        twin.begin(log, faults or FaultPlan())
    except BaseException:
        log.close()
        raise
    return twin


def _replay(record: TruthRecord) -> tuple[Twin, list[TruthList]]:
    """The twin at the last line of the record, and what it told on the way, by process."""
    first = record.processes[0].world
    sinks = [TruthList()]
    twin = Twin(
        decode(Nominal, first["nominal"]),
        decode(Scene, first["scene"]),
        int(first["seed"]),
        sinks[0],
        _faults(record.processes[0]),
        decode(TrueMachine, first["true"]),
    )
    for number, process in enumerate(record.processes):
        if number > 0:
            _rest(twin)
            sinks.append(TruthList())
            twin.begin(sinks[-1], _faults(process))
        for timed in process.commands:
            twin.apply(timed.t, timed.command)
        twin.advance(max(twin.now_s, process.last_t))
    return twin, sinks


def _rest(twin: Twin) -> None:
    """Let the physics run until nothing moves, or as long as a machine without faults could need."""
    limit_s = twin.now_s + twin.nominal.pulse_max_s + SETTLE_S
    while not twin.physics.resting and twin.now_s < limit_s:
        twin.advance(twin.now_s + RUN_ON_STEP_S)


def _faults(process: ProcessTruth) -> FaultPlan:
    return FaultPlan(parse_fault(text) for text in process.world["faults"])


def _events(sink: TruthList) -> list[dict[str, Any]]:
    return [line for line in sink.lines if line["kind"] == "event"]
