"""What a client of NTRIP says and hears: version 2.0 (HTTP/1.1, RTCM 10410.1) and version 1.0 (``ICY 200 OK``)."""

from __future__ import annotations

import asyncio
import base64
import re
from collections.abc import AsyncGenerator
from dataclasses import dataclass, field
from pathlib import Path

from drivers.errors import DeviceError, DeviceFault, DeviceLost, WrongDevice

DEVICE = "ntrip"
AGENT = "NTRIP sprayer/1.0"
LINE_BYTES = 8192
MOST_HEADERS = 100
READ_BYTES = 4096
LONGEST_CHUNK = 1 << 20
TABLE_BYTES = 1 << 18
NOT_UNDERSTOOD = (400, 405, 501, 505)  # answers of casters that know version 1 only

_PLAIN = re.compile(r"[^\s/?#:]+")
_STATUS = re.compile(r"(HTTP/1\.[01]|ICY|SOURCETABLE) (\d{3})(?: (.*))?")


@dataclass(frozen=True, slots=True)
class NtripSettings:
    """A mountpoint of a caster. Our position goes up every ``gga_every_s`` (0: never), as virtual stations need it.

    ``tls`` checks the certificate, against ``tls_ca_file`` where the caster has an authority of its own.
    Without a correction for ``timeout_s`` the connection counts as dead. Raises ``ValueError``.
    """

    host: str
    mountpoint: str
    port: int = 2101
    user: str = ""
    password: str = field(default="", repr=False)
    tls: bool = False
    tls_ca_file: Path | None = None
    gga_every_s: float = 10.0
    timeout_s: float = 15.0

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[^\s/?#]+", self.host) or not 1 <= self.port <= 65_535:
            raise ValueError(f"ntrip: expected a host and a port, found {self.host!r} {self.port}; correct them")
        if not _PLAIN.fullmatch(self.mountpoint):
            raise ValueError(f"ntrip: expected a mountpoint's name, found {self.mountpoint!r}; correct it")
        if ":" in self.user or any(not text.isprintable() for text in (self.user, self.password)):
            raise ValueError("ntrip: expected a user without colon and a printable password; correct them")
        if not self.timeout_s > 0.0 or not self.gga_every_s >= 0.0:
            raise ValueError("ntrip: expected positive times; correct timeout_s and gga_every_s")

    @property
    def place(self) -> str:
        return f"{self.host}:{self.port}/{self.mountpoint}"


class NotUnderstood(Exception):
    """The caster does not know this version of the protocol."""


@dataclass(frozen=True, slots=True)
class Answer:
    """First line and headers (names in lower case). ``protocol`` is HTTP/1.1, HTTP/1.0, ICY or SOURCETABLE."""

    protocol: str
    status: int
    reason: str
    headers: dict[str, str]

    @property
    def is_table(self) -> bool:
        return self.protocol == "SOURCETABLE" or "sourcetable" in self.headers.get("content-type", "")

    @property
    def is_chunked(self) -> bool:
        return "chunked" in self.headers.get("transfer-encoding", "").lower()


def request(settings: NtripSettings, version: int, gga: bytes) -> bytes:
    """The request for the stream of a mountpoint."""
    lines = [f"GET /{settings.mountpoint} HTTP/1.{1 if version == 2 else 0}", f"User-Agent: {AGENT}"]
    if version == 2:
        lines += [f"Host: {settings.host}:{settings.port}", "Ntrip-Version: Ntrip/2.0", "Connection: close"]
        if gga and settings.gga_every_s > 0.0:
            lines.append(f"Ntrip-GGA: {gga.decode('ascii')}")
    if settings.user or settings.password:
        secret = base64.b64encode(f"{settings.user}:{settings.password}".encode()).decode("ascii")
        lines.append(f"Authorization: Basic {secret}")
    return "\r\n".join([*lines, "", ""]).encode("utf-8")


async def read_answer(reader: asyncio.StreamReader) -> Answer:
    """``NotUnderstood`` when the caster hangs up without a word; ``WrongDevice`` when it speaks something else."""
    try:
        first = (await reader.readuntil(b"\n")).decode("latin-1").strip()
    except asyncio.IncompleteReadError as error:
        if error.partial:
            raise _no_caster(error.partial) from None
        raise NotUnderstood from None
    except asyncio.LimitOverrunError:
        raise _no_caster(b"a line without end") from None
    match = _STATUS.fullmatch(first)
    if match is None:
        raise _no_caster(first.encode("latin-1"))
    # version 1 may send data right after its first line; headers that follow are no frames and do no harm
    headers = {} if match[1] == "ICY" else await _headers(reader)
    return Answer(match[1], int(match[2]), match[3] or "", headers)


async def _headers(reader: asyncio.StreamReader) -> dict[str, str]:
    headers: dict[str, str] = {}
    for _ in range(MOST_HEADERS):
        try:
            line = (await reader.readuntil(b"\n")).decode("latin-1").strip()
        except (asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            break
        if not line:
            return headers
        name, _, value = line.partition(":")
        headers[name.strip().lower()] = value.strip()
    raise WrongDevice(DEVICE, "the headers of an answer", "headers without end", "check host and port of the caster")


async def check(settings: NtripSettings, answer: Answer, reader: asyncio.StreamReader) -> None:
    """Return when a stream of corrections follows. ``NotUnderstood``, or the ``DeviceError`` for whom it concerns."""
    place, found = settings.place, f"{answer.status} {answer.reason}".strip()
    if answer.status in (401, 403):
        raise DeviceFault(DEVICE, f"access to {place}", found, "check user and password, and the account at the caster")
    if answer.status in NOT_UNDERSTOOD:
        raise NotUnderstood
    if answer.status == 404 or (answer.status == 200 and answer.is_table):
        names = await _mountpoints(reader, answer) if answer.is_table else []
        known = f"; it has {', '.join(names[:12])}{' ...' if len(names) > 12 else ''}" if names else ""
        raise DeviceFault(DEVICE, f"a stream at {place}", f"no such mountpoint{known}", "correct the mountpoint")
    if answer.status != 200:
        raise DeviceFault(DEVICE, f"a stream at {place}", found, "ask the caster's operator; it is tried again")


async def _mountpoints(reader: asyncio.StreamReader, answer: Answer) -> list[str]:
    table = b""
    try:
        async for data in body(reader, answer):
            table += data
            if b"ENDSOURCETABLE" in table or len(table) > TABLE_BYTES:
                break
    except DeviceError:  # what there is of the table serves
        pass
    records = [line.split(";") for line in table.decode("latin-1").splitlines()]
    return [record[1] for record in records if len(record) > 1 and record[0] == "STR"]


async def body(reader: asyncio.StreamReader, answer: Answer) -> AsyncGenerator[bytes, None]:
    """What follows the answer, as it comes, to its end. ``DeviceFault`` when the chunks of HTTP/1.1 are broken."""
    if not answer.is_chunked:
        while data := await reader.read(READ_BYTES):
            yield data
        return
    while True:
        try:
            size = int((await reader.readuntil(b"\r\n")).split(b";")[0], 16)
            if not 0 <= size <= LONGEST_CHUNK:
                raise ValueError(size)
            data = await reader.readexactly(size + 2)
        except asyncio.IncompleteReadError:
            return
        except (ValueError, asyncio.LimitOverrunError):
            raise DeviceFault(DEVICE, "chunks of HTTP/1.1", "something else", "it is connected anew") from None
        if size == 0:
            return
        yield data[:-2]


def ended(settings: NtripSettings) -> DeviceLost:
    return DeviceLost(DEVICE, f"the stream of {settings.place} to go on", "its end", "it is connected anew")


def _no_caster(said: bytes) -> WrongDevice:
    return WrongDevice(DEVICE, "an answer of an NTRIP caster", repr(said[:40]), "check host and port of the caster")
