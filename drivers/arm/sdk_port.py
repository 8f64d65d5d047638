"""The maker's SDK on a line of ours: its transmit repaired, its receive waiting instead of spinning."""

from __future__ import annotations

import time
from collections.abc import Sequence

from dynamixel_sdk.protocol2_packet_handler import (
    COMM_PORT_BUSY,
    COMM_SUCCESS,
    COMM_TX_ERROR,
    DXL_HIBYTE,
    DXL_LOBYTE,
    DXL_MAKEWORD,
    PKT_ID,
    PKT_INSTRUCTION,
    PKT_LENGTH_H,
    PKT_LENGTH_L,
    TXPACKET_MAX_LEN,
    Protocol2PacketHandler,
)

from drivers.arm import protocol2
from drivers.line import Line

CRC_BYTES = 2
KEPT_BYTES = 48  # of what was heard, for the one who has to find out what it was


class SdkPort:
    """What the SDK calls a port handler, over an open ``Line``; belongs to the line's thread.

    A packet may take its time on the wire and ``patience_s`` more. While it ``holds`` what is written, it goes out in
    one piece with the next that is not held.
    """

    def __init__(self, line: Line, patience_s: float) -> None:
        self.is_using = False
        self.holds = False
        self.patience_s = patience_s
        self.heard = b""
        self._line = line
        self._held = b""
        self._sent_bytes = 0
        self._deadline_s = 0.0

    def clearPort(self) -> None:
        """Throw away what came before the request."""
        if not self.holds:
            self._line.drain()
            self.heard = b""

    def writePort(self, packet: list[int]) -> int:
        data, self._held = self._held + bytes(packet), b""
        if self.holds:
            self._held = data
        else:
            self._line.write(data)
            self._sent_bytes = len(data)
        return len(packet)

    def readPort(self, length: int) -> bytes:
        """``length`` bytes, fewer only when the packet's time is over."""
        data = self._line.read(max(0, length), self._deadline_s - time.monotonic())
        if len(self.heard) < KEPT_BYTES:
            self.heard += data
        return data

    def setPacketTimeout(self, packet_length: int) -> None:
        wire_s = (packet_length + self._sent_bytes) * self._line.settings.byte_s
        self._deadline_s = time.monotonic() + wire_s + self.patience_s

    def setPacketTimeoutMillis(self, milliseconds: float) -> None:
        self._deadline_s = time.monotonic() + milliseconds / 1000.0

    def isPacketTimeout(self) -> bool:
        return time.monotonic() >= self._deadline_s

    def getBaudRate(self) -> int:
        return self._line.settings.baud


class PacketHandler(Protocol2PacketHandler):  # type: ignore[misc]
    """Sends the stuffed packet, where the SDK stuffs a copy and sends the original."""

    def addStuffing(self, packet: list[int]) -> list[int]:
        """The packet without its CRC, stuffed from the instruction on, its length made to fit."""
        size = DXL_MAKEWORD(packet[PKT_LENGTH_L], packet[PKT_LENGTH_H])
        body = bytes(packet[PKT_INSTRUCTION : PKT_INSTRUCTION + size - CRC_BYTES])
        stuffed = protocol2.stuff(body)
        length = len(stuffed) + CRC_BYTES
        return [*protocol2.HEADER, packet[PKT_ID], DXL_LOBYTE(length), DXL_HIBYTE(length), *stuffed]

    def removeStuffing(self, packet: list[int]) -> list[int]:
        """Most packets have nothing to remove."""
        if protocol2.STUFFED not in bytes(packet):
            return packet
        unstuffed: list[int] = super().removeStuffing(packet)
        return unstuffed

    def txPacket(self, port: SdkPort, txpacket: list[int]) -> int:
        if port.is_using:
            return int(COMM_PORT_BUSY)
        packet = self.addStuffing(txpacket)
        if len(packet) + CRC_BYTES > TXPACKET_MAX_LEN:
            return int(COMM_TX_ERROR)
        crc = protocol2.crc16(bytes(packet))
        packet += DXL_LOBYTE(crc), DXL_HIBYTE(crc)
        port.clearPort()
        port.writePort(packet)
        port.is_using = True
        return int(COMM_SUCCESS)

    def updateCRC(self, crc_accum: int, data_blk_ptr: Sequence[int], data_blk_size: int) -> int:
        return protocol2.crc16(bytes(data_blk_ptr[:data_blk_size]), crc_accum)
