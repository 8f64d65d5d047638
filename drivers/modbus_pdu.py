"""Modbus requests and what a valid answer to each must look like (Modbus Application Protocol V1.1b3)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadDiscreteInputsRequest, WriteMultipleCoilsRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING, READ_INPUT_REGISTERS = 1, 2, 3, 4
WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS = 5, 6, 15, 16
READS = frozenset({READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING, READ_INPUT_REGISTERS})
ERROR_BIT = 0x80

COIL_ON, COIL_OFF = 0xFF00, 0x0000

EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge, still at work",
    6: "device busy",
    7: "negative acknowledge",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target did not answer",
}


class RawCoil(ModbusPDU):
    """Function 05 with any 16-bit value: relay boards put a time there, where the standard knows on and off only."""

    function_code = WRITE_COIL
    rtu_frame_size = 8

    def __init__(self, address: int = 0, value: int = 0) -> None:
        super().__init__(address=address)
        self.value = value

    def encode(self) -> bytes:
        return struct.pack(">HH", self.address, self.value)

    def decode(self, data: bytes) -> None:
        self.address, self.value = struct.unpack(">HH", data)


class Request:
    """A request: its bytes, how long its answer is, and which answer fits.

    ``payload`` begins with the function code; lengths do not count unit id, checksum and TCP header.
    """

    def __init__(self, pdu: ModbusPDU, answer_bytes: int) -> None:
        self.function = pdu.function_code
        self.payload = bytes([pdu.function_code]) + pdu.encode()
        self.answer_bytes = answer_bytes

    @property
    def reads(self) -> bool:
        return self.function in READS

    def answered_by(self, payload: bytes) -> bool:
        """Whether ``payload`` (of the right function and length) answers this request and no other."""
        if self.reads:
            return payload[1] == len(payload) - 2
        return payload[1:] == self.payload[1:5]  # writes echo address and value, or address and count


def read_bits(function: int, address: int, count: int) -> Request:
    """Coils (01) or discrete inputs (02)."""
    kind = ReadCoilsRequest if function == READ_COILS else ReadDiscreteInputsRequest
    return Request(kind(address=address, count=count), 2 + (count + 7) // 8)


def read_words(function: int, address: int, count: int) -> Request:
    """Holding registers (03) or input registers (04)."""
    kind = ReadHoldingRegistersRequest if function == READ_HOLDING else ReadInputRegistersRequest
    return Request(kind(address=address, count=count), 2 + 2 * count)


def write_coil(address: int, value: int) -> Request:
    return Request(RawCoil(address, value), 5)


def write_register(address: int, value: int) -> Request:
    return Request(WriteSingleRegisterRequest(address=address, registers=[value]), 5)


def write_coils(address: int, values: Sequence[bool]) -> Request:
    return Request(WriteMultipleCoilsRequest(address=address, bits=values), 5)


def write_registers(address: int, values: Sequence[int]) -> Request:
    return Request(WriteMultipleRegistersRequest(address=address, registers=values), 5)


def exception_name(code: int) -> str:
    return EXCEPTIONS.get(code, f"exception {code}")
