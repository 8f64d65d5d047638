"""The relay board."""

from drivers.relay.interface import RelayBoard
from drivers.relay.values import BoardCapability, Channel, PulseReceipt, RelayState

__all__ = ["BoardCapability", "Channel", "PulseReceipt", "RelayBoard", "RelayState"]
