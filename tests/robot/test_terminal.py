"""What is typed: keys of a terminal, lines of a pipe."""

from __future__ import annotations

import asyncio
import os
import pty
import termios
import time
from collections.abc import Iterator

import pytest

from robot.clock import run_real, run_virtual
from robot.commands.terminal import ANSWER_S, Answers, at_terminal, keys_of
from robot.errors import UsageError


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"w", ("w",)),
        (b"WwA", ("w", "w", "a")),
        (b"\x1b[A\x1b[B\x1bOC\x1b[D", ("up", "down", "right", "left")),
        (b"\x1b", ("other",)),
        (b"\x1b[3~", ("other",)),
        (b"\x1b[", ("other",)),
        (b"w\x1b[5~w", ("w", "other")),
        (b"\xff\x00", ("\ufffd", "\x00")),
        (b"", ()),
    ],
)
def test_keys_have_names_and_what_is_none_of_them_is_another_key(data, keys):
    assert keys_of(data) == keys


@pytest.fixture
def pipe(monkeypatch) -> Iterator[int]:
    """The writing end of a pipe that is the standard input."""
    reader, writer = os.pipe()
    with os.fdopen(reader) as stream:
        monkeypatch.setattr("sys.stdin", stream)
        yield writer


def test_lines_of_a_pipe_come_one_by_one_and_then_the_end(pipe):
    os.write(pipe, b" 1.5 \n\nlast")
    os.close(pipe)

    async def main() -> list[str]:
        answers = Answers()
        lines = [answers.ask_at_once("first? "), await answers.ask("next? "), await answers.ask("next? ")]
        assert answers.ended
        return [*lines, await answers.ask("more? ")]

    assert run_virtual(main()) == ["1.5", "", "last", ""]


@pytest.mark.parametrize("run", [run_virtual, run_real])
def test_a_question_that_nobody_answers_does_not_hold_up_the_end(run, pipe):
    async def main() -> None:
        asking = asyncio.create_task(Answers().ask("well? "))
        await asyncio.sleep(0.05)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking

    began_s = time.monotonic()
    run(main())
    assert time.monotonic() - began_s < 20.0
    os.close(pipe)


def test_an_answer_takes_its_time_in_virtual_time(pipe):
    os.write(pipe, b"1\n")
    os.close(pipe)

    async def main() -> float:
        await Answers().ask("one? ")
        return asyncio.get_running_loop().time()

    assert run_virtual(main()) == ANSWER_S


def test_keys_need_a_terminal(pipe):
    with pytest.raises(UsageError, match="the standard input is none; sit down"), at_terminal("sit down"):
        pass
    os.close(pipe)


@pytest.fixture
def seat(monkeypatch) -> Iterator[tuple[int, int]]:
    """The two ends of a terminal that is the standard input: the person's and the program's."""
    master, slave = pty.openpty()
    with os.fdopen(slave) as stream:
        monkeypatch.setattr("sys.stdin", stream)
        yield master, slave


def test_keys_come_without_enter_and_the_terminal_is_as_before_afterwards(seat):
    master, slave = seat
    before = termios.tcgetattr(slave)
    with at_terminal("") as keys:
        assert keys.within(0.01) == ()
        os.write(master, b"w\x1b[A")
        assert keys.within(5.0) == ("w", "up")
        assert termios.tcgetattr(slave) != before
    assert termios.tcgetattr(slave) == before
    os.close(master)


def test_a_terminal_that_hangs_up_is_told(seat):
    master, _ = seat
    with at_terminal("") as keys:
        os.close(master)
        assert keys.within(5.0) is None
