"""The modem and its network: signal, registration, texts in and out."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from drivers.modem.values import ModemStatus, Sms
from drivers.twin.nominal import Nominal

FADING_DB = 2.0
DELIVERY_S = 2.0  # from a phone through the service centre to the modem


@dataclass(frozen=True, slots=True)
class SentText:
    """A text that the network took from the robot at ``at_s``."""

    at_s: float
    number: str
    text: str


class Network:
    """``outbox`` holds what the robot sent, in order."""

    def __init__(self, nominal: Nominal) -> None:
        self._nominal = nominal
        self._inbox: list[tuple[float, str, str]] = []
        self.registered = True
        self.outbox: list[SentText] = []

    def status(self, stamp_s: float, noise: np.random.Generator) -> ModemStatus:
        if not self.registered:
            return ModemStatus(stamp_s, True, False, None, None)
        signal = round(self._nominal.modem_signal_dbm + float(noise.normal(0.0, FADING_DB)))
        return ModemStatus(stamp_s, True, True, self._nominal.modem_operator, float(min(-51, max(-113, signal))))

    def send(self, t_s: float, number: str, text: str) -> None:
        self.outbox.append(SentText(t_s, number, text))

    def deliver(self, t_s: float, sender: str, text: str) -> None:
        """Somebody sends the robot a text; it arrives after the network's delay."""
        self._inbox.append((t_s, sender, text))

    def waiting(self, t_s: float, epoch_s: float) -> tuple[Sms, ...]:
        """What has arrived and was not taken, oldest first; ``epoch_s`` is where the run's clock began."""
        start = self._nominal.start_utc
        return tuple(
            Sms(sender, text, start + timedelta(seconds=sent_s), sent_s + DELIVERY_S - epoch_s)
            for sent_s, sender, text in self._inbox
            if sent_s + DELIVERY_S <= t_s
        )

    def take(self, t_s: float) -> None:
        """Empty the store of what has arrived."""
        self._inbox = [text for text in self._inbox if text[0] + DELIVERY_S > t_s]
