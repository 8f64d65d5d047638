"""A trace is what went over the port, or it is refused."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.byte_trace import ByteTrace, Chunk, TraceHead, read_trace

HEAD = TraceHead("relay", "modbus", "/dev/serial/by-id/relay", 9600)
CHUNKS = [Chunk(0.5, "out", b"\x01\x05"), Chunk(0.51, "in", b"\xff"), Chunk(1.0, "in", b"")]


def written(path: Path, chunks: list[Chunk], longest_bytes: int = 10_000) -> Path:
    trace = ByteTrace(path, HEAD, longest_bytes)
    for chunk in chunks:
        trace.keep(chunk.stamp_s, chunk.direction, chunk.data)
    trace.close()
    return path


@given(st.lists(st.builds(
    Chunk, st.floats(0.0, 1e6).map(lambda t: round(t, 6)), st.sampled_from(["in", "out"]), st.binary(max_size=40)
), max_size=8))  # fmt: skip
def test_what_is_kept_is_read_back(chunks: list[Chunk]) -> None:
    with TemporaryDirectory() as folder:
        head, found = read_trace(written(Path(folder) / "trace", chunks))
        assert (head, list(found)) == (HEAD, chunks)


def test_a_trace_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    trace = ByteTrace(tmp_path / "t", HEAD)
    trace.keep(0.5, "out", b"\x01\x05")
    assert list(read_trace(tmp_path / "t")[1]) == CHUNKS[:1]
    trace.close()
    trace.keep(0.6, "out", b"late")
    assert list(read_trace(tmp_path / "t")[1]) == CHUNKS[:1]


def test_a_trace_stops_to_grow_and_says_so(tmp_path: Path) -> None:
    path = written(tmp_path / "t", CHUNKS * 100, longest_bytes=1000)
    assert path.stat().st_size < 1100
    assert path.read_text().endswith('{"note":"the trace is full"}\n')
    kept = list(read_trace(path)[1])
    assert kept == (CHUNKS * 100)[: len(kept)]
    assert len(kept) > 10


def test_a_torn_last_line_is_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path / "t", CHUNKS)
    path.write_bytes(path.read_bytes()[:-5])
    assert list(read_trace(path)[1]) == CHUNKS[:2]


@pytest.mark.parametrize(
    "content", [b"", b"\n", b"{}\n", b"[1]\n", b"\x7fELF\x00\xff\xfe\n", b'{"device": "relay"}\n', b"3\n"]
)
def test_another_kind_of_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "t").write_bytes(content)
    with pytest.raises(ValueError, match="expected a byte trace, found another kind of file"):
        read_trace(tmp_path / "t")


@pytest.mark.parametrize(
    "line",
    [
        b"half", b'{"t":1.0}', b"7", b'{"t":1.0,"dir":"up","hex":"00"}', b'{"t":1.0,"dir":"in","hex":"0"}',
        b'{"t":"x","dir":"in","hex":"00"}', b"\xff",
    ],
)  # fmt: skip
def test_a_line_that_is_none_is_named_by_its_number(tmp_path: Path, line: bytes) -> None:
    path = written(tmp_path / "t", CHUNKS)
    path.write_bytes(path.read_bytes() + line + b"\n")
    chunks = read_trace(path)[1]
    assert [next(chunks) for _ in CHUNKS] == CHUNKS
    with pytest.raises(ValueError, match="line 5 is not of a byte trace"):
        next(chunks)
