"""The commands of texts that an emulated modem knows (3GPP 27.005)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from drivers.modem import at_words
from drivers.modem.concatenation import alphabet_for
from drivers.modem.emulated_commands import AtError, Radio, Reply, number, require_sim, words
from drivers.modem.emulated_sim import DRAFT, DRAFT_SENT, RECEIVED_READ, RECEIVED_UNREAD, StoredPdu, TextStore
from drivers.modem.emulated_state import ModemState
from drivers.modem.pdu import Submit, decode_deliver, decode_submit, encode_submit

INVALID_PDU, INVALID_INDEX, NOT_SUPPORTED, MEMORY_FULL = 304, 321, 303, 322
STATES = {"REC UNREAD": 0, "REC READ": 1, "STO UNSENT": 2, "STO SENT": 3, "ALL": 4}
STORES = ("SM", "ME")
INTERNATIONAL, NATIONAL = 145, 129
_REPORT_ASKED = 0x20


class Sender(Radio, Protocol):
    """A radio that texts can be given to."""

    def store(self, use: int) -> TextStore:
        """For reading and deleting (0), writing (1), receiving (2)."""
        ...

    def store_named(self, name: str) -> TextStore: ...

    def transmit(self, submit: Submit) -> None:
        """The result follows when the network has it."""
        ...

    def store_draft(self, entry: StoredPdu) -> None: ...

    def deleted(self) -> None:
        """Something has left the store."""
        ...


TextHandler = Callable[[Sender, str], Reply]


def _message_error(code: int) -> AtError:
    return AtError(code, "+CMS ERROR")


def _require_store(radio: Radio) -> None:
    try:
        require_sim(radio)
    except AtError as error:
        code = {at_words.SIM_ABSENT: 310, at_words.SIM_PIN_REQUIRED: 311, at_words.SIM_PUK_REQUIRED: 316}
        raise _message_error(code[error.code or at_words.SIM_ABSENT]) from None


def _format(radio: Sender, form: str) -> Reply:
    if form == "?":
        return Reply([f"+CMGF: {radio.state.format}"])
    if form == "=?":
        return Reply(["+CMGF: (0,1)"])
    radio.state.format = number(form[1:], 0, 1)
    return Reply()


def _smsc(radio: Sender, form: str) -> Reply:
    _require_store(radio)
    if form == "?":
        smsc = radio.state.smsc or radio.sim.smsc
        return Reply([f'+CSCA: "{smsc}",{INTERNATIONAL if smsc.startswith("+") else NATIONAL}'])
    told = words(form[1:])
    if not told or not told[0].removeprefix("+").isdigit():
        raise _message_error(305)
    radio.state.smsc = told[0]
    return Reply()


def _stores(radio: Sender, form: str) -> Reply:
    _require_store(radio)
    if form == "=?":
        names = "(" + ",".join(f'"{name}"' for name in STORES) + ")"
        return Reply([f"+CPMS: {names},{names},{names}"])
    if form == "?":
        return Reply(["+CPMS: " + ",".join(f'"{name}",{_filling(radio, name)}' for name in radio.state.stores)])
    told = words(form[1:])
    if not 1 <= len(told) <= 3 or any(name not in STORES for name in told):
        raise _message_error(302)
    radio.state.stores = (*told, *radio.state.stores[len(told) :])  # type: ignore[assignment]  # three again
    return Reply([f"+CPMS: {','.join(_filling(radio, name) for name in radio.state.stores)}"])


def _filling(radio: Sender, name: str) -> str:
    store = radio.store_named(name)
    return f"{len(store.slots)},{store.capacity}"


def _notices(radio: Sender, form: str) -> Reply:
    if form == "?":
        return Reply(["+CNMI: " + ",".join(map(str, radio.state.notices))])
    if form == "=?":
        return Reply(["+CNMI: (0-2),(0-3),(0,2,3),(0-2),(0,1)"])
    limits = (2, 3, 3, 2, 1)
    told = words(form[1:])
    if len(told) > len(limits):
        raise AtError(50)
    figures = [number(word, *range(limit + 1)) for word, limit in zip(told, limits, strict=False)]
    radio.state.notices = (*figures, *radio.state.notices[len(figures) :])
    return Reply()


def _parameters(radio: Sender, form: str) -> Reply:
    if form == "?":
        return Reply(["+CSMP: " + ",".join(map(str, radio.state.parameters))])
    if form != "=?":
        figures = [number(word, *range(256)) for word in words(form[1:])]
        radio.state.parameters = (*figures, *radio.state.parameters[len(figures) :])[:4]
    return Reply()


def _service(radio: Sender, form: str) -> Reply:
    if form == "?":
        return Reply(["+CSMS: 0,1,1,1"])
    return Reply(["+CSMS: (0,1)"] if form == "=?" else ["+CSMS: 1,1,1"])


def _show(radio: Sender, form: str) -> Reply:
    if form not in ("?", "=?"):
        radio.state.show_parameters = bool(number(form[1:], 0, 1))
        return Reply()
    return Reply([f"+CSDH: {int(radio.state.show_parameters)}"])


def _list(radio: Sender, form: str) -> Reply:
    _require_store(radio)
    if form == "=?":
        return Reply(["+CMGL: (0-4)" if radio.state.format == 0 else '+CMGL: ("REC UNREAD","REC READ","ALL")'])
    word = words(form[1:])[:1] if form else []
    if radio.state.format == 1:
        wanted = STATES.get(word[0] if word else "REC UNREAD")
        if wanted is None:
            raise _message_error(305)
    else:
        wanted = number(word[0], 0, 1, 2, 3, 4) if word else RECEIVED_UNREAD
    lines: list[str] = []
    for slot, entry in sorted(radio.store(0).slots.items()):
        if wanted in (4, entry.state):
            lines.append("\r\n".join(_shown(radio.state, entry, f"+CMGL: {slot},")))
            entry.state = RECEIVED_READ if entry.state == RECEIVED_UNREAD else entry.state
    return Reply(lines)


def _read(radio: Sender, form: str) -> Reply:
    _require_store(radio)
    slot = number(form[1:].partition(",")[0])
    store = radio.store(0)
    if not 1 <= slot <= store.capacity:
        raise _message_error(INVALID_INDEX)
    entry = store.slots.get(slot)
    if entry is None:
        return Reply()
    lines = ["\r\n".join(_shown(radio.state, entry, "+CMGR: "))]
    entry.state = RECEIVED_READ if entry.state == RECEIVED_UNREAD else entry.state
    return Reply(lines)


def _delete(radio: Sender, form: str) -> Reply:
    _require_store(radio)
    store = radio.store(0)
    if form == "=?":
        return Reply([f"+CMGD: ({','.join(map(str, sorted(store.slots)))}),(0-4)"])
    told = words(form[1:])
    slot, flag = number(told[0] if told else ""), number(told[1], 0, 1, 2, 3, 4) if len(told) > 1 else 0
    if flag:
        states = {1: (1,), 2: (1, 3), 3: (1, 2, 3), 4: (0, 1, 2, 3)}[flag]
        for each in [each for each, entry in store.slots.items() if entry.state in states]:
            del store.slots[each]
    elif not 1 <= slot <= store.capacity:
        raise _message_error(INVALID_INDEX)
    else:
        store.slots.pop(slot, None)
    radio.deleted()
    return Reply()


def _send(radio: Sender, form: str) -> Reply:
    _require_store(radio)
    return Reply(prompt=_after_prompt(radio, form, radio.transmit))


def _write(radio: Sender, form: str) -> Reply:
    _require_store(radio)

    def keep(submit: Submit) -> None:
        radio.store_draft(StoredPdu(DRAFT, *encode_submit(submit)))

    return Reply(prompt=_after_prompt(radio, form, keep))


def _after_prompt(radio: Sender, form: str, use: Callable[[Submit], None]) -> Callable[[str], None]:
    told = words(form[1:])
    if radio.state.format == 1:
        if not told or not told[0]:
            raise _message_error(305)
        return lambda body: use(_from_text(radio.state, told[0], body))
    announced = number(told[0] if told else "")
    return lambda body: use(_from_pdu(body, announced))


def _from_pdu(body: str, announced: int) -> Submit:
    """Strict: the length has to be the true one."""
    pdu = body.strip()
    try:
        octets = len(pdu) // 2 - 1 - int(pdu[:2], 16)
        submit = decode_submit(pdu)
        encode_submit(submit)  # a number that is none is refused too
    except ValueError:
        raise _message_error(INVALID_PDU) from None
    if octets != announced:
        raise _message_error(INVALID_PDU)
    return submit


def _from_text(state: ModemState, number_told: str, body: str) -> Submit:
    try:
        text = state.read(body.replace("\r", "\n") if state.charset in ("GSM", "IRA") else body)
        submit = Submit(number_told, text, alphabet_for(text), report=bool(state.parameters[0] & _REPORT_ASKED))
        encode_submit(submit)
    except ValueError:
        raise _message_error(305) from None
    return submit


def _shown(state: ModemState, entry: StoredPdu, head: str) -> list[str]:
    """The head and the body under it."""
    if state.format == 0:
        return [f"{head}{entry.state},,{entry.octets}", entry.pdu]
    name = next(name for name, value in STATES.items() if value == entry.state)
    try:
        if entry.state in (DRAFT, DRAFT_SENT):
            submit = decode_submit(entry.pdu)
            return [f'{head}"{name}","{submit.number}",""', state.write(submit.text)]
        deliver = decode_deliver(entry.pdu)
    except ValueError:
        return [f'{head}"{name}","",""', ""]
    stamp = ""
    if deliver.sent_utc is not None:
        stamp = f"{deliver.sent_utc:%y/%m/%d,%H:%M:%S}+00"
    return [f'{head}"{name}","{deliver.sender}","","{stamp}"', state.write(deliver.text)]


TEXTS: dict[str, TextHandler] = {
    "+CMGF": _format, "+CSCA": _smsc, "+CPMS": _stores, "+CNMI": _notices, "+CSMP": _parameters, "+CSMS": _service,
    "+CSDH": _show, "+CMGL": _list, "+CMGR": _read, "+CMGD": _delete, "+CMGS": _send, "+CMGW": _write,
}  # fmt: skip
