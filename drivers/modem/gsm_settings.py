"""What a GSM modem is told before it is opened."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class GsmSettings:
    """``pin``: of the SIM, when it asks for one. ``smsc``: the service centre, when it is not the SIM's own.

    ``storage``: where texts lie, "SM" the SIM, "ME" the modem. ``poll_s``: how often state and store are looked at
    unasked. ``send_timeout_s``: for the network to take one part of a text. ``answer_timeout_s``: for any other
    command. ``parts_keep_s``: how long parts of a text wait for the others.
    """

    pin: str | None = field(default=None, repr=False)
    smsc: str | None = None
    storage: Literal["SM", "ME"] = "SM"
    poll_s: float = 10.0
    send_timeout_s: float = 60.0
    answer_timeout_s: float = 5.0
    delivery_reports: bool = False
    parts_keep_s: float = 3600.0

    def __post_init__(self) -> None:
        if self.pin is not None and not (self.pin.isascii() and self.pin.isdigit() and 4 <= len(self.pin) <= 8):
            raise ValueError("pin: expected 4 to 8 digits, found something else; correct the PIN of the SIM")
        for name in ("poll_s", "send_timeout_s", "answer_timeout_s", "parts_keep_s"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: expected more than 0 s, found {getattr(self, name)}; correct the value")
