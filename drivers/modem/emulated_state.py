"""What an emulated modem has been told, and how it writes strings."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.modem import gsm7

CHARSETS = ("GSM", "HEX", "IRA", "UCS2", "8859-1")


@dataclass(slots=True)
class ModemState:
    """As after power-up. ``errors`` 0: ERROR alone, 1: numbers, 2: words. ``format`` of texts: 0 PDU, 1 text."""

    echo: bool = True
    errors: int = 0
    registration: int = 0
    packet_registration: int = 0
    lte_registration: int = 0
    format: int = 0
    charset: str = "GSM"
    notices: tuple[int, ...] = (1, 0, 0, 0, 0)
    parameters: tuple[int, ...] = (17, 167, 0, 0)
    smsc: str | None = None
    stores: tuple[str, str, str] = ("SM", "SM", "SM")
    operator_format: int = 0
    caller_shown: bool = False
    show_parameters: bool = False
    functional: int = 1

    def write(self, text: str) -> str:
        """A string as the chosen character set spells it, one character an octet."""
        if self.charset == "UCS2":
            return text.encode("utf-16-be", "replace").hex().upper()
        septets = [septet for each in text for septet in gsm7.septets_of(each if gsm7.width(each) else "?")]
        if self.charset == "HEX":
            return bytes(septets).hex().upper()
        if self.charset == "GSM":
            return bytes(septets).decode("latin-1")
        return text.encode("latin-1" if self.charset == "8859-1" else "ascii", "replace").decode("latin-1")

    def read(self, told: str) -> str:
        """Back from the character set. Raises ``ValueError``."""
        if self.charset == "UCS2":
            return bytes.fromhex(told).decode("utf-16-be")
        if self.charset == "HEX":
            return gsm7.text_of([octet & 0x7F for octet in bytes.fromhex(told)])
        if self.charset == "GSM":
            return gsm7.text_of([ord(each) & 0x7F for each in told])
        return told
