"""What Modbus units say, as bytes after the function code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.emulation.modbus_slave import ILLEGAL_ADDRESS, ModbusException


def bits(states: Sequence[bool], address: int, count: int) -> bytes:
    """Some of ``states`` as an answer of function 01 or 02 holds them."""
    if address + count > len(states):
        raise ModbusException(ILLEGAL_ADDRESS)
    told = states[address : address + count]
    data = sum(bool(on) << place for place, on in enumerate(told)).to_bytes((count + 7) // 8, "little")
    return bytes([len(data)]) + data


def words(registers: Mapping[int, int], address: int, count: int) -> bytes:
    """Some of ``registers``, by address, as an answer of function 03 or 04 holds them."""
    try:
        told = [registers[address + place] for place in range(count)]
    except KeyError:
        raise ModbusException(ILLEGAL_ADDRESS) from None
    return bytes([2 * count]) + b"".join((word & 0xFFFF).to_bytes(2, "big") for word in told)
