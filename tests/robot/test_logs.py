"""What is written to a journal and to a person, and what a flood of one fault leaves of it."""

import io
import logging
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.logs import BURST, KINDS_MAX, WINDOW_S, LimitedHandler, fields, journal_handler, set_up_logs

LOG = logging.getLogger("robot.test")


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(autouse=True)
def logging_as_before() -> Iterator[None]:
    root, robot = logging.getLogger(), logging.getLogger("robot")
    before = root.handlers[:], root.level, robot.level
    yield
    root.handlers[:], levels = before[0], before[1:]
    root.setLevel(levels[0])
    robot.setLevel(levels[1])


def journal_of(path: Path) -> dict[str, str]:
    status = path.stat()
    return {"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}


def test_a_journal_gets_priorities_fields_and_notices(tmp_path, clock):
    with (tmp_path / "journal").open("w") as stream:
        handler = set_up_logs(stream, journal_of(tmp_path / "journal"), clock)
        assert journal_handler() is handler
        LOG.info("up", extra=fields(waiting=True, control="/run/sprayer/control.sock"))
        LOG.warning("relay lost", extra=fields(device="relay", why='found "silence"; plug it in', after_s=1.23456))
        LOG.error("mode %s", "safe_stop")
        logging.getLogger("other").info("nobody asked")
    assert (tmp_path / "journal").read_text().splitlines() == [
        "<6>robot.test: up waiting=True control=/run/sprayer/control.sock",
        '<4>robot.test: relay lost device=relay why="found \\"silence\\"; plug it in" after_s=1.235',
        "<3>robot.test: mode safe_stop",
    ]


def test_every_line_of_a_traceback_has_its_priority(tmp_path, clock):
    with (tmp_path / "journal").open("w") as stream:
        set_up_logs(stream, journal_of(tmp_path / "journal"), clock)
        try:
            raise ZeroDivisionError("defect")
        except ZeroDivisionError:
            LOG.exception("broken")
    lines = (tmp_path / "journal").read_text().splitlines()
    assert len(lines) >= 4
    assert all(line.startswith("<3>") for line in lines)


@pytest.mark.parametrize("variable", ["", "1:2", "nonsense"])
def test_a_stream_that_is_not_the_journals_gets_plain_text_and_no_notices(variable, tmp_path, clock):
    with (tmp_path / "file").open("w") as stream:
        set_up_logs(stream, {"JOURNAL_STREAM": variable}, clock)
        assert journal_handler() is None
        LOG.info("up")
        LOG.warning("relay lost", extra=fields(device="relay"))
    assert (tmp_path / "file").read_text() == "WARNING robot.test: relay lost device=relay\n"


def test_a_stream_without_a_descriptor_is_no_journal(clock):
    set_up_logs(io.StringIO(), {"JOURNAL_STREAM": "1:2"}, clock)
    assert journal_handler() is None


def test_a_second_set_up_takes_the_place_of_the_first(clock):
    first, second = io.StringIO(), io.StringIO()
    set_up_logs(first, {}, clock)
    set_up_logs(second, {}, clock)
    LOG.warning("once")
    assert (first.getvalue(), second.getvalue()) == ("", "WARNING robot.test: once\n")


def flooded(clock: Clock, lines: int, text: str = "sensors: silent for %.1f s") -> tuple[LimitedHandler, io.StringIO]:
    stream = io.StringIO()
    handler = set_up_logs(stream, {}, clock)
    for number in range(lines):
        clock.now_s += WINDOW_S / (2 * lines)
        LOG.warning(text, number)
    return handler, stream


def test_a_fault_that_repeats_ten_thousand_times_leaves_ten_lines_and_their_count(clock):
    handler, stream = flooded(clock, 10_000)
    assert len(stream.getvalue().splitlines()) == BURST
    clock.now_s += WINDOW_S
    handler.write_counts()
    last = stream.getvalue().splitlines()[-1]
    assert last == "WARNING robot.test: repeated: sensors: silent for # s times=9990 within_s=10.000"
    handler.write_counts()
    assert len(stream.getvalue().splitlines()) == BURST + 1


def test_a_flood_hides_no_other_line(clock):
    _, stream = flooded(clock, 1000)
    LOG.error("the valve leaks")
    assert stream.getvalue().splitlines()[-1] == "ERROR robot.test: the valve leaks"


def test_the_count_is_written_at_the_end_of_the_program_too(clock):
    handler, stream = flooded(clock, 25)
    handler.close()
    assert "times=15" in stream.getvalue().splitlines()[-1]


def test_a_flood_of_ever_other_texts_is_bounded_too(clock):
    stream = io.StringIO()
    set_up_logs(stream, {}, clock)
    for number in range(5000):
        LOG.warning("x" * (number + 1))
    assert len(stream.getvalue().splitlines()) <= KINDS_MAX + BURST


def test_a_message_that_does_not_fit_its_values_is_never_raised_at_the_one_who_logs(clock, monkeypatch):
    told = io.StringIO()
    monkeypatch.setattr(sys, "stderr", told)
    handler = set_up_logs(io.StringIO(), {}, clock)
    handler.handle(LOG.makeRecord(LOG.name, logging.WARNING, "", 0, "%d things", ("three",), None))
    assert "three" in told.getvalue()


def test_standard_error_is_the_stream_when_none_is_given(monkeypatch, clock):
    told = io.StringIO()
    monkeypatch.setattr(sys, "stderr", told)
    set_up_logs(environment=os.environ, clock=clock)
    LOG.warning("here")
    assert told.getvalue() == "WARNING robot.test: here\n"
