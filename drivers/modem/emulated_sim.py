"""An emulated SIM: its lock and its numbers; and stores of texts, on the SIM and in the modem."""

from __future__ import annotations

from dataclasses import dataclass, field

PIN_TRIES, PUK_TRIES = 3, 10
SIM_SLOTS, MODEM_SLOTS = 30, 50
RECEIVED_UNREAD, RECEIVED_READ, DRAFT, DRAFT_SENT = 0, 1, 2, 3


@dataclass(slots=True)
class StoredPdu:
    """A PDU in a slot. ``octets`` as ``+CMGL`` tells them, without the service centre's; ``text`` is whose it is."""

    state: int
    pdu: str
    octets: int
    text: int | None = None


@dataclass(slots=True)
class TextStore:
    """Slots count from 1."""

    capacity: int
    slots: dict[int, StoredPdu] = field(default_factory=dict)

    def store(self, entry: StoredPdu) -> int | None:
        """The slot, the lowest that is free; None when there is none."""
        for slot in range(1, self.capacity + 1):
            if slot not in self.slots:
                self.slots[slot] = entry
                return slot
        return None

    @property
    def free(self) -> int:
        return self.capacity - len(self.slots)


@dataclass(slots=True)
class EmulatedSim:
    """``pin`` None: never asked for. ``inserted`` False: the reader finds none."""

    pin: str | None = None
    puk: str = "12345678"
    inserted: bool = True
    smsc: str = "+491710760000"
    number: str = "+491700000001"
    imsi: str = "262011234567890"
    pin_tries: int = PIN_TRIES
    puk_tries: int = PUK_TRIES
    unlocked: bool = False
    texts: TextStore = field(default_factory=lambda: TextStore(SIM_SLOTS))

    @property
    def state(self) -> str:
        """As ``+CPIN`` tells it."""
        if self.pin is None or self.unlocked:
            return "READY"
        if self.pin_tries > 0:
            return "SIM PIN"
        return "SIM PUK"

    @property
    def ready(self) -> bool:
        return self.inserted and self.state == "READY"

    def power_up(self) -> None:
        """The lock falls shut; tries and store stay."""
        self.unlocked = False

    def enter_pin(self, pin: str) -> bool:
        if self.state != "SIM PIN":
            return False
        if pin == self.pin:
            self.unlocked, self.pin_tries = True, PIN_TRIES
        else:
            self.pin_tries -= 1
        return self.unlocked

    def enter_puk(self, puk: str, new_pin: str) -> bool:
        if self.state != "SIM PUK" or self.puk_tries == 0:
            return False
        if puk != self.puk:
            self.puk_tries -= 1
            return False
        self.pin, self.unlocked, self.pin_tries, self.puk_tries = new_pin, True, PIN_TRIES, PUK_TRIES
        return True
