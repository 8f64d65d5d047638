"""The frames that switch a board off, as bytes: for whoever must send them without a driver."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.modbus_frames import with_crc
from drivers.relay.board_profile import BoardProfile


def all_off_frames(profile: BoardProfile, unit_id: int, channels: Sequence[int]) -> tuple[bytes, ...]:
    """RTU frames that open every coil and stop the timers of ``channels``, the first named first.

    ``unit_id`` 0 is the broadcast, which nobody answers.
    """
    return tuple(with_crc(bytes([unit_id]) + write.request().payload) for write in profile.all_off(channels))
