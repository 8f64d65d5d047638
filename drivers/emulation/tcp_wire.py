"""A TCP connection in the place of a serial wire: a device, or a gateway, that listens on the loopback."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

READ_BYTES = 4096


class TcpWire:
    """One host at a time, as small gateways have it; the newest takes the place of the one before.

    ``scheme`` is "tcp" or "rtu+tcp". ``byte_s`` is of the serial line behind a gateway, 0 without one.
    """

    def __init__(
        self, receive: Callable[[bytes], None], scheme: str = "tcp", byte_s: float = 0.0, host: str = "127.0.0.1"
    ) -> None:
        self.byte_s = byte_s
        self._receive, self._scheme, self._host = receive, scheme, host
        self._port = 0
        self._server: asyncio.Server | None = None
        self._host_writer: asyncio.StreamWriter | None = None

    @property
    def path(self) -> str:
        return f"{self._scheme}://{self._host}:{self._port}"

    async def plug(self) -> None:
        """Listen, on the same port as before if there was one."""
        self._server = await asyncio.start_server(self._serve, self._host, self._port, reuse_address=True)
        self._port = self._server.sockets[0].getsockname()[1]

    async def unplug(self) -> None:
        """Stop to listen and end the connection."""
        if self._server is not None:
            self._server.close()
            self._hang_up()
            await self._server.wait_closed()
            self._server = None

    def send(self, data: bytes, delay_s: float = 0.0) -> None:
        """Give ``data`` to the host after ``delay_s`` and its time on the line behind."""
        loop = asyncio.get_running_loop()
        loop.call_later(delay_s + len(data) * self.byte_s, self._write, data, self._host_writer)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._hang_up()
        self._host_writer = writer
        try:
            while data := await reader.read(READ_BYTES):
                self._receive(data)
        except ConnectionError:
            pass  # the host went without a word, which is its right
        finally:
            writer.close()

    def _write(self, data: bytes, writer: asyncio.StreamWriter | None) -> None:
        if writer is not None and not writer.is_closing():
            writer.write(data)

    def _hang_up(self) -> None:
        if self._host_writer is not None:
            self._host_writer.close()
            self._host_writer = None
