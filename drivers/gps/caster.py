"""An NTRIP caster with a base station of its own, for rovers that have no other."""

from __future__ import annotations

import asyncio
import base64
import ssl
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np

from drivers.gps.base_station import BaseStation

HEADER_BYTES = 8192


class CasterFault(StrEnum):
    """What the caster does wrong. DROP hangs up on everyone; STALL says nothing more and keeps the connection;
    GARBAGE turns bits; REFUSE answers 401 to everyone.
    """

    OK = "ok"
    DROP = "drop"
    STALL = "stall"
    GARBAGE = "garbage"
    REFUSE = "refuse"


@dataclass(frozen=True, slots=True)
class CasterSettings:
    """``mountpoints`` by name; ``users`` and their passwords (none: open to all). Version 1 knows no HTTP/1.1."""

    mountpoints: Mapping[str, BaseStation]
    users: Mapping[str, str]
    version: Literal[1, 2] = 2
    interval_s: float = 1.0


class Caster:
    """Serves on the event loop from ``start`` to ``stop``. ``clock`` gives loop time."""

    def __init__(self, settings: CasterSettings, clock: Callable[[], float]) -> None:
        self._settings, self._clock = settings, clock
        self._random = np.random.default_rng(0xCA57)
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.Task[None]] = set()
        self.fault = CasterFault.OK
        self.requests: deque[str] = deque(maxlen=100)
        self.positions: deque[bytes] = deque(maxlen=100)

    @property
    def clients(self) -> int:
        """Connections that are open."""
        return len(self._clients)

    async def start(self, host: str = "127.0.0.1", port: int = 0, tls: ssl.SSLContext | None = None) -> int:
        """Returns the port."""
        self._server = await asyncio.start_server(self._serve, host, port, ssl=tls, limit=HEADER_BYTES)
        return int(self._server.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
        for client in tuple(self._clients):
            client.cancel()
        for client in tuple(self._clients):
            with suppress(asyncio.CancelledError):
                await client
        if self._server is not None:
            await self._server.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = asyncio.current_task()
        assert client is not None
        self._clients.add(client)
        try:
            await self._answer(reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # the client has gone
        except asyncio.CancelledError:
            pass  # stopped; the server waits for nobody
        finally:
            self._clients.discard(client)
            writer.transport.abort()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        self.requests.append(head)
        first, *lines = head.split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        newer = first.endswith("HTTP/1.1") and headers.get("ntrip-version", "").lower() == "ntrip/2.0"
        if newer and self._settings.version == 1:
            newer = False
        name = first.split(" ")[1].removeprefix("/") if first.count(" ") >= 2 else ""
        if self.fault is CasterFault.REFUSE or not self._knows(headers.get("authorization", "")):
            writer.write(b'HTTP/1.%d 401 Unauthorized\r\nWWW-Authenticate: Basic realm="caster"\r\n\r\n' % newer)
        elif name not in self._settings.mountpoints:
            writer.write(self._table(newer))
        else:
            writer.write(_HEAD_2 if newer else b"ICY 200 OK\r\n\r\n")
            await self._stream(self._settings.mountpoints[name], reader, writer, newer)
        await writer.drain()
        writer.close()
        await writer.wait_closed()

    def _knows(self, authorization: str) -> bool:
        if not self._settings.users:
            return True
        try:
            user, _, password = base64.b64decode(authorization.removeprefix("Basic ")).decode().partition(":")
        except ValueError:
            return False
        return user in self._settings.users and self._settings.users[user] == password

    def _table(self, newer: bool) -> bytes:
        records = [
            f"STR;{name};;RTCM 3.2;1005(1),1074(1),1084(1);2;GPS+GLO;;;"
            f"{base.latitude_deg:.2f};{base.longitude_deg:.2f};0;0;sprayer;none;B;N;2400;"
            for name, base in self._settings.mountpoints.items()
        ]
        table = "\r\n".join([*records, "ENDSOURCETABLE", ""])
        kind = "HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0" if newer else "SOURCETABLE 200 OK"
        mime = "gnss/sourcetable" if newer else "text/plain"
        return f"{kind}\r\nContent-Type: {mime}\r\nContent-Length: {len(table)}\r\n\r\n{table}".encode("ascii")

    async def _stream(
        self, base: BaseStation, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, chunked: bool
    ) -> None:
        listening = asyncio.create_task(self._listen(reader))
        try:
            while self.fault is not CasterFault.DROP and not listening.done():
                if self.fault is not CasterFault.STALL:
                    data = b"".join(base.epoch(self._clock()))
                    if self.fault is CasterFault.GARBAGE:
                        data = bytes(np.frombuffer(data, np.uint8) ^ self._random.integers(1, 256, len(data), np.uint8))
                    writer.write(b"%x\r\n%b\r\n" % (len(data), data) if chunked else data)
                    await writer.drain()
                await asyncio.sleep(self._settings.interval_s)
        finally:
            listening.cancel()
            with suppress(asyncio.CancelledError, OSError, ValueError):
                await listening

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        """Positions of the rover, until it hangs up."""
        while line := await reader.readline():
            self.positions.append(line.strip())


_HEAD_2 = (
    b"HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nServer: NTRIP sprayer/1.0\r\nContent-Type: gnss/data\r\n"
    b"Connection: close\r\nTransfer-Encoding: chunked\r\n\r\n"
)
