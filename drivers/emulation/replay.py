"""A recorded session played back: the device's side of a byte trace, for a driver that says what it said then."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from drivers.byte_trace import Chunk

SHOWN_BYTES = 16


class ReplayDeviation(AssertionError):
    """The host wrote something else than it did in the recorded session, or less."""


@dataclass(frozen=True, slots=True)
class _Answer:
    """What the device began to say ``after_s`` the last byte of the host."""

    after_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class _Turn:
    """All that the host wrote without a word of the device, and all that the device said then."""

    stamp_s: float
    asked: bytes
    answers: tuple[_Answer, ...]


class Replay:
    """The peer at the end of a ``PtyWire``: ``receive`` is what the wire is made with, ``connect`` gets its ``send``.

    What the host writes may come in other pieces than then. Answers come as long after it as they did, less their own
    time on the wire. A host that deviates gets no answer any more, and ``require_done`` says where it did.
    """

    def __init__(self, chunks: Iterable[Chunk], byte_s: float) -> None:
        """``byte_s`` is the time of a byte on the wire that it will be played over."""
        self._turns = _turns(chunks, byte_s)
        self._send: Callable[[bytes, float], None] | None = None
        self._turn = 0
        self._heard = b""
        self._count = 0
        self._deviation = ""

    def connect(self, send: Callable[[bytes, float], None]) -> None:
        """``send(data, delay_s)`` is the wire's. What the device said unasked at first comes from now on."""
        self._send = send
        if self._turns and not self._turns[0].asked:
            self._answer()

    @property
    def done(self) -> bool:
        """Whether the host has written all that it wrote then."""
        return not self._deviation and self._turn == len(self._turns)

    def receive(self, data: bytes) -> None:
        """What the host wrote."""
        if self._deviation:
            return
        self._heard += data
        while self._heard and not self._deviation:
            if self._turn == len(self._turns):
                self._deviate(0.0, 0, b"")
                return
            turn = self._turns[self._turn]
            common = min(len(turn.asked), len(self._heard))
            if self._heard[:common] != turn.asked[:common]:
                place = next(k for k in range(common) if self._heard[k] != turn.asked[k])
                self._deviate(turn.stamp_s, place, turn.asked)
            elif common < len(turn.asked):
                return
            else:
                self._heard = self._heard[common:]
                self._count += common
                self._answer()

    def require_done(self) -> None:
        """``ReplayDeviation`` unless the host has written just what it wrote in the recorded session."""
        if self._deviation:
            raise ReplayDeviation(self._deviation)
        if self._turn < len(self._turns):
            turn = self._turns[self._turn]
            raise ReplayDeviation(
                f"after {self._count + len(self._heard)} bytes: expected {_shown(turn.asked[len(self._heard) :])} "
                f"(at {turn.stamp_s:.6f} s of the trace), found nothing more"
            )

    def _answer(self) -> None:
        assert self._send is not None  # connected before anything can be received
        for answer in self._turns[self._turn].answers:
            self._send(answer.data, answer.after_s)
        self._turn += 1

    def _deviate(self, stamp_s: float, place: int, asked: bytes) -> None:
        expected = f"{_shown(asked[place:])} (at {stamp_s:.6f} s of the trace)" if asked else "nothing more"
        self._deviation = f"byte {self._count + place}: expected {expected}, found {_shown(self._heard[place:])}"


def _turns(chunks: Iterable[Chunk], byte_s: float) -> Sequence[_Turn]:
    turns: list[_Turn] = []
    asked, answers, began_s, heard_s = b"", list[_Answer](), 0.0, None
    for chunk in chunks:
        if chunk.direction == "in":
            heard_s = chunk.stamp_s if heard_s is None else heard_s
            after_s = max(0.0, chunk.stamp_s - heard_s - len(chunk.data) * byte_s)
            answers.append(_Answer(after_s, chunk.data))
            continue
        if answers:
            turns.append(_Turn(began_s, asked, tuple(answers)))
            asked, answers = b"", []
        began_s = began_s if asked else chunk.stamp_s
        asked, heard_s = asked + chunk.data, chunk.stamp_s
    if asked or answers:
        turns.append(_Turn(began_s, asked, tuple(answers)))
    return turns


def _shown(data: bytes) -> str:
    more = f" and {len(data) - SHOWN_BYTES} more" if len(data) > SHOWN_BYTES else ""
    return data[:SHOWN_BYTES].hex(" ") + more
