"""The state of the robot as Prometheus metrics."""

from __future__ import annotations

from collections.abc import Iterable

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.registry import Collector

from robot.control.machine import LatenessCounts, PortCounts, Status
from robot.safety import Mode
from robot.supervision import Health

CONTENT_TYPE = CONTENT_TYPE_LATEST


def metrics_text(status: Status, lateness: LatenessCounts, ports: Iterable[PortCounts]) -> bytes:
    """The text format of Prometheus, UTF-8."""
    registry = CollectorRegistry()
    registry.register(_Now((*_state(status), *_tasks(status), _lateness(lateness), _ports(ports))))
    return generate_latest(registry)


class _Now(Collector):
    def __init__(self, metrics: tuple[Metric, ...]) -> None:
        self._metrics = metrics

    def collect(self) -> Iterable[Metric]:
        return self._metrics


def _state(status: Status) -> Iterable[Metric]:
    modes = GaugeMetricFamily("sprayer_mode", "1 for the mode that the machine is in", labels=("mode",))
    for mode in Mode:
        modes.add_metric((str(mode),), float(mode is status.mode))
    yield modes
    yield GaugeMetricFamily("sprayer_faults_active", "Active faults", value=len(status.faults))
    yield GaugeMetricFamily("sprayer_healthy", "1 while every task gives signs of life", value=not status.unhealthy)
    yield GaugeMetricFamily("sprayer_up_seconds", "Since the program came up", value=status.now_s)
    yield GaugeMetricFamily("sprayer_stop_number", "The stop of the row, from 1", value=status.mission.stop)
    targets = GaugeMetricFamily("sprayer_targets", "Targets of the task by fate", labels=("fate",))
    for fate, count in status.mission.targets.items():
        targets.add_metric((fate,), count)
    yield targets
    if status.ledger is not None:
        ledger = status.ledger
        yield GaugeMetricFamily("sprayer_task_shots", "Openings of the valve in the task", value=ledger.shots)
        yield GaugeMetricFamily("sprayer_task_booked_millilitres", "Booked in the task", value=ledger.booked_ml)
        yield GaugeMetricFamily("sprayer_task_pending_millilitres", "Of shots under way", value=ledger.pending_ml)
    if status.tank_left_ml is not None:
        yield GaugeMetricFamily("sprayer_tank_millilitres", "Left in the tank", value=status.tank_left_ml)


def _tasks(status: Status) -> Iterable[Metric]:
    labels = ("task", "owner")
    states = GaugeMetricFamily("sprayer_task_state", "1 for the task's state", labels=(*labels, "state"))
    beats = CounterMetricFamily("sprayer_task_beats", "Steps that went well", labels=labels)
    errors = CounterMetricFamily("sprayer_task_errors", "Steps that failed, and silences", labels=labels)
    rates = GaugeMetricFamily("sprayer_task_hertz", "Measured rate", labels=labels)
    expected = GaugeMetricFamily("sprayer_task_expected_hertz", "Expected rate", labels=labels)
    for task in status.tasks:
        place = (task.name, task.owner)
        for state in Health:
            states.add_metric((*place, str(state)), float(state is task.state))
        beats.add_metric(place, task.beats)
        errors.add_metric(place, task.errors)
        if task.expected_hz:
            rates.add_metric(place, task.measured_hz)
            expected.add_metric(place, task.expected_hz)
    return states, beats, errors, rates, expected


def _lateness(lateness: LatenessCounts) -> Metric:
    total, buckets = 0, []
    for bound, count in zip([*map(str, lateness.bounds_s), "+Inf"], lateness.counts, strict=True):
        total += count
        buckets.append((bound, float(total)))
    return HistogramMetricFamily(
        "sprayer_loop_lateness_seconds", "How late a tick of the event loop came", buckets, lateness.sum_s
    )


def _ports(ports: Iterable[PortCounts]) -> Metric:
    family = CounterMetricFamily("sprayer_port_events", "Counters of a port", labels=("device", "event"))
    for port in ports:
        for name, count in port.counts.items():
            family.add_metric((port.device, name), count)
    return family
