"""A receiver's output in a file, epoch by epoch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

from drivers.gps.epochs import Epoch, EpochAssembler
from drivers.gps.sentence_reader import ReaderStatistics, SentenceReader

LINE_BYTES = 65_536


class RawLog:
    """The epochs of what a binary stream holds, lines that begin with ``#`` left out. Any bytes will do."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._reader = SentenceReader(0.0, capped=False)

    @property
    def statistics(self) -> ReaderStatistics:
        return self._reader.statistics

    def epochs(self) -> Iterator[Epoch]:
        assembler = EpochAssembler()
        for data in self._without_comments():
            for _, sentence in self._reader.feed(data, 0.0):
                yield from assembler.add(sentence)
        yield from assembler.quiet()

    def _without_comments(self) -> Iterator[bytes]:
        begins, comment = True, False
        while line := self._stream.readline(LINE_BYTES):
            if begins:
                comment = line.startswith(b"#")
            begins = line.endswith(b"\n")
            if not comment:
                yield line
