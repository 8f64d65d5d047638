"""The PDUs of text messages: SUBMIT to the network, DELIVER and STATUS-REPORT from it (3GPP 23.040, section 9.2).

In hexadecimal as a modem in PDU mode takes and gives them, the service centre's address first. Whatever cannot be
decoded raises ``ValueError`` that says why, and never another exception.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from drivers.modem.pdu_fields import (
    Octets,
    encode_address,
    encode_smsc,
    encode_stamp,
    encode_validity,
    stamp_of,
    take_address,
    take_smsc,
    validity_of,
)
from drivers.modem.user_data import (
    Alphabet,
    Part,
    coding_octet,
    encode_user_data,
    message_class_of,
    take_user_data,
)

_DELIVER, _SUBMIT, _REPORT, _KIND = 0x00, 0x01, 0x02, 0x03
_NO_MORE, _REPORT_ASKED, _HAS_HEADER = 0x04, 0x20, 0x40
_VALIDITY, _RELATIVE = 0x18, 0x10
_LONG_VALIDITY_OCTETS = 7


@dataclass(frozen=True, slots=True)
class Submit:
    """A text on its way to the network. ``smsc`` None: the SIM's own; ``validity_s`` None: the network's own."""

    number: str
    text: str
    alphabet: Alphabet = Alphabet.GSM7
    part: Part | None = None
    smsc: str | None = None
    reference: int = 0
    validity_s: float | None = None
    report: bool = False


@dataclass(frozen=True, slots=True)
class Deliver:
    """A text from the network. ``sent_utc`` is None when the service centre's stamp is no date."""

    sender: str
    text: str
    sent_utc: datetime | None
    alphabet: Alphabet = Alphabet.GSM7
    part: Part | None = None
    smsc: str | None = None
    message_class: int | None = None


@dataclass(frozen=True, slots=True)
class StatusReport:
    """What became of a text: ``reference`` is that which ``+CMGS`` gave, ``status`` a code of 23.040, 9.2.3.15."""

    reference: int
    number: str
    status: int
    sent_utc: datetime | None
    done_utc: datetime | None
    smsc: str | None = None

    @property
    def delivered(self) -> bool:
        return self.status < 0x20

    @property
    def final(self) -> bool:
        """Whether the service centre has ended its attempts."""
        return not 0x20 <= self.status < 0x40


def encode_submit(submit: Submit) -> tuple[str, int]:
    """The PDU, and the octets behind the service centre's address, which ``AT+CMGS`` wants to know."""
    flags = _SUBMIT | (_REPORT_ASKED if submit.report else 0) | (_HAS_HEADER if submit.part else 0)
    validity = b""
    if submit.validity_s is not None:
        flags |= _RELATIVE
        validity = bytes([encode_validity(submit.validity_s)])
    body = (
        bytes([flags, submit.reference & 0xFF])
        + encode_address(submit.number)
        + bytes([0, coding_octet(submit.alphabet)])
        + validity
        + encode_user_data(submit.text, submit.alphabet, submit.part)
    )
    return _hex(encode_smsc(submit.smsc), body)


def decode_submit(pdu: str) -> Submit:
    """A validity of seven octets (absolute or enhanced) is passed over."""
    octets = Octets(pdu)
    smsc = take_smsc(octets)
    flags = _flags(octets, _SUBMIT, "SUBMIT")
    reference = octets.one("reference")
    number = take_address(octets, "number")
    octets.one("protocol")
    coding = octets.one("coding")
    validity_s: float | None = None
    if flags & _VALIDITY == _RELATIVE:
        validity_s = validity_of(octets.one("validity"))
    elif flags & _VALIDITY:
        octets.take(_LONG_VALIDITY_OCTETS, "validity")
    text, alphabet, part = take_user_data(octets, coding, bool(flags & _HAS_HEADER))
    _require_end(octets)
    return Submit(number, text, alphabet, part, smsc, reference, validity_s, bool(flags & _REPORT_ASKED))


def encode_deliver(deliver: Deliver) -> tuple[str, int]:
    if deliver.sent_utc is None:
        raise ValueError("expected a text with its stamp, found none")
    flags = _DELIVER | _NO_MORE | (_HAS_HEADER if deliver.part else 0)
    body = (
        bytes([flags])
        + encode_address(deliver.sender)
        + bytes([0, coding_octet(deliver.alphabet, deliver.message_class)])
        + encode_stamp(deliver.sent_utc)
        + encode_user_data(deliver.text, deliver.alphabet, deliver.part)
    )
    return _hex(encode_smsc(deliver.smsc), body)


def decode_deliver(pdu: str) -> Deliver:
    octets = Octets(pdu)
    smsc = take_smsc(octets)
    flags = _flags(octets, _DELIVER, "DELIVER")
    sender = take_address(octets, "sender")
    octets.one("protocol")
    coding = octets.one("coding")
    sent = stamp_of(octets.take(7, "stamp"))
    text, alphabet, part = take_user_data(octets, coding, bool(flags & _HAS_HEADER))
    _require_end(octets)
    return Deliver(sender, text, sent, alphabet, part, smsc, message_class_of(coding))


def encode_status_report(report: StatusReport) -> tuple[str, int]:
    if report.sent_utc is None or report.done_utc is None:
        raise ValueError("expected a report with its stamps, found none")
    body = (
        bytes([_REPORT | _NO_MORE, report.reference])
        + encode_address(report.number)
        + encode_stamp(report.sent_utc)
        + encode_stamp(report.done_utc)
        + bytes([report.status])
    )
    return _hex(encode_smsc(report.smsc), body)


def decode_status_report(pdu: str) -> StatusReport:
    """Fields that may follow the status are passed over."""
    octets = Octets(pdu)
    smsc = take_smsc(octets)
    _flags(octets, _REPORT, "STATUS-REPORT")
    reference = octets.one("reference")
    number = take_address(octets, "number")
    sent = stamp_of(octets.take(7, "stamp"))
    done = stamp_of(octets.take(7, "time of delivery"))
    return StatusReport(reference, number, octets.one("status"), sent, done, smsc)


def _flags(octets: Octets, kind: int, name: str) -> int:
    flags = octets.one("kind")
    if flags & _KIND != kind:
        raise ValueError(f"expected a {name}, found a PDU of another kind ({flags & _KIND})")
    return flags


def _require_end(octets: Octets) -> None:
    if octets.left:
        raise ValueError(f"expected the end of the PDU, found {octets.left} more octets")


def _hex(smsc: bytes, body: bytes) -> tuple[str, int]:
    return (smsc + body).hex().upper(), len(body)
