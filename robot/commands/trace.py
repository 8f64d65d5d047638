"""``sprayer trace``: the bytes of a port, as a run with ``--trace`` kept them, in words."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from drivers.arm.decode import DynamixelDecoder
from drivers.byte_trace import FULL, Chunk, Direction, TraceHead, read_trace
from drivers.gps.decode import NmeaDecoder
from drivers.line import TCP
from drivers.modbus_decode import ModbusDecoder
from drivers.modem.decode import AtDecoder
from drivers.trace_decoder import TraceDecoder, Wrong
from robot.errors import FileError, UsageError

_MARKS: dict[Direction, str] = {"out": ">", "in": "<"}
_DECODERS: dict[str, Callable[[TraceHead], TraceDecoder]] = {
    "at": lambda head: AtDecoder(),
    "dynamixel": lambda head: DynamixelDecoder(),
    "modbus": lambda head: ModbusDecoder(tcp=head.path.startswith(TCP)),
    "nmea": lambda head: NmeaDecoder(),
}


def trace(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A trace that a run wrote (--trace DIR).")],
    raw: Annotated[bool, typer.Option("--raw", help="The bytes as they came, in hex, undecoded.")] = False,
    from_s: Annotated[
        float, typer.Option("--from", metavar="S", help="Only what came S seconds or more into the run.")
    ] = -math.inf,
    to_s: Annotated[float, typer.Option("--to", metavar="S", help="Only what came up to then.")] = math.inf,
    errors: Annotated[
        bool, typer.Option("--errors", help="Only what is wrong: broken bytes, and answers that refuse.")
    ] = False,
) -> None:
    """Print a line for each frame, sentence or line of text: seconds, > from the robot or < to it, what it says."""
    if raw and errors:
        raise UsageError("--errors needs the bytes decoded and --raw shows them undecoded; leave one of them out")
    if math.isnan(from_s) or math.isnan(to_s):
        raise UsageError("--from, --to: expected seconds of the run's clock, found nan")
    try:
        for line in _shown(file, raw, from_s, to_s, errors):
            sys.stdout.write(line + "\n")
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read the lines has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _shown(file: Path, raw: bool, from_s: float, to_s: float, errors: bool) -> Iterator[str]:
    try:
        head, chunks = read_trace(file)
        yield f"# {head.device} at {head.path}, {head.protocol}, {head.baud} baud"
        last_s = -math.inf
        for stamp_s, mark, text in _hex(chunks) if raw else _decoded(head, chunks, file):
            last_s = last_s if math.isnan(stamp_s) else stamp_s
            if from_s <= last_s <= to_s and (isinstance(text, Wrong) or not errors):
                yield f"{'' if math.isnan(stamp_s) else format(stamp_s, '.6f'):>13} {mark} {text}"
    except ValueError as error:
        raise FileError(str(error)) from error
    if why := _cut_short(file):
        raise FileError(f"{file}: {why}; all before it is shown")


def _hex(chunks: Iterator[Chunk]) -> Iterator[tuple[float, str, str]]:
    for chunk in chunks:
        yield chunk.stamp_s, _MARKS[chunk.direction], chunk.data.hex(" ")


def _decoded(head: TraceHead, chunks: Iterator[Chunk], file: Path) -> Iterator[tuple[float, str, str]]:
    """Stamp, mark, line; a line's stamp is that of the bytes that completed it, nan for what never was."""
    if head.protocol not in _DECODERS:
        known = ", ".join(sorted(_DECODERS))
        raise FileError(f"{file}: expected a protocol of {known}, found '{head.protocol}'; use --raw")
    decoder = _DECODERS[head.protocol](head)
    for chunk in chunks:
        for text in decoder.feed(chunk.direction, chunk.data):
            yield chunk.stamp_s, _MARKS[chunk.direction], text
    for text in decoder.rest():
        yield math.nan, " ", text


def _cut_short(file: Path) -> str:
    """Why the trace does not go on to the end of its run, "" when it does."""
    with file.open("rb") as stream:
        stream.seek(max(0, stream.seek(0, os.SEEK_END) - len(FULL)))
        tail = stream.read()
    if tail == FULL:
        return "it had grown to its longest and ends before its run"
    return "" if tail.endswith(b"\n") else "its last line is torn, as a run leaves it that is killed"
