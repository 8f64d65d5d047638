"""The commands that an emulated modem knows: general ones, those of the SIM and of the network (V.250, 3GPP 27.007)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from drivers.modem import at_words
from drivers.modem.emulated_sim import EmulatedSim
from drivers.modem.emulated_state import CHARSETS, ModemState

MAKER, MODEL, REVISION, SERIAL = "SIMCOM_Ltd", "SIMCOM_SIM800L", "Revision:1418B05SIM800L24", "867856030000000"
AREA, CELL = "1A2B", "00C3"
SEARCHING, HOME, IDLE = 2, 1, 0
_WORDS = re.compile(r'"([^"]*)"|([^,]+)|(?<=,)(?=,|$)|^(?=,)')
BAD_PARAMETERS, NOT_ALLOWED, NOT_SUPPORTED = 50, 3, 4


class AtError(Exception):
    """``code`` of ``kind``; None: a plain ERROR."""

    def __init__(self, code: int | None = None, kind: str = "+CME ERROR") -> None:
        super().__init__(code, kind)
        self.code, self.kind = code, kind


@dataclass(slots=True)
class Reply:
    """Lines of an answer; or ``prompt``: what becomes of the text that follows."""

    lines: list[str] = field(default_factory=list)
    prompt: Callable[[str], None] | None = None


class Radio(Protocol):
    """What of the modem's surroundings the commands see."""

    state: ModemState
    sim: EmulatedSim

    @property
    def registered(self) -> bool: ...

    @property
    def operator(self) -> str: ...

    def signal(self) -> int:
        """As ``+CSQ`` tells it."""
        ...

    def restart(self) -> None: ...

    def sim_unlocked(self) -> None: ...


Handler = Callable[[Radio, str], Reply]


def words(arguments: str) -> list[str]:
    """Arguments without their quotes."""
    return [match[1] if match[1] is not None else (match[2] or "").strip() for match in _WORDS.finditer(arguments)]


def number(word: str, *allowed: int) -> int:
    """Raises ``AtError`` for what is no number, or not one of those allowed."""
    if not (word.isascii() and word.isdigit() and len(word) < 10) or (allowed and int(word) not in allowed):
        raise AtError(BAD_PARAMETERS)
    return int(word)


def require_sim(radio: Radio) -> None:
    if not radio.sim.inserted:
        raise AtError(at_words.SIM_ABSENT)
    if radio.sim.state != "READY":
        raise AtError(at_words.SIM_PIN_REQUIRED if radio.sim.state == "SIM PIN" else at_words.SIM_PUK_REQUIRED)


def _tells(*lines: str) -> Handler:
    return lambda radio, form: Reply(list(lines))


def _errors(radio: Radio, form: str) -> Reply:
    if form == "?":
        return Reply([f"+CMEE: {radio.state.errors}"])
    if form != "=?":
        radio.state.errors = number(form[1:], 0, 1, 2)
        return Reply()
    return Reply(["+CMEE: (0,1,2)"])


def _pin(radio: Radio, form: str) -> Reply:
    sim = radio.sim
    if not sim.inserted:
        raise AtError(at_words.SIM_ABSENT)
    if form == "?":
        return Reply([f"+CPIN: {sim.state}"])
    told = words(form[1:])
    if sim.state == "READY":
        raise AtError(NOT_ALLOWED)
    if sim.state == "SIM PUK":
        accepted = len(told) == 2 and sim.enter_puk(told[0], told[1])
    else:
        accepted = len(told) == 1 and sim.enter_pin(told[0])
    if not accepted:
        raise AtError(at_words.SIM_PUK_REQUIRED if sim.state == "SIM PUK" else at_words.WRONG_PIN)
    radio.sim_unlocked()
    return Reply()


def _tries(radio: Radio, form: str) -> Reply:
    return Reply([f"+SPIC: {radio.sim.pin_tries},{radio.sim.puk_tries},0,10"])


def _charset(radio: Radio, form: str) -> Reply:
    if form == "?":
        return Reply([f'+CSCS: "{radio.state.charset}"'])
    if form == "=?":
        return Reply(["+CSCS: (" + ",".join(f'"{name}"' for name in CHARSETS) + ")"])
    told = words(form[1:])
    if len(told) != 1 or told[0] not in CHARSETS:
        raise AtError(BAD_PARAMETERS)
    radio.state.charset = told[0]
    return Reply()


def registration_state(radio: Radio) -> int:
    if radio.registered:
        return HOME
    return SEARCHING if radio.state.functional == 1 and radio.sim.ready else IDLE


def registration_notice(name: str, wanted: int, state: int) -> str:
    place = f',"{AREA}","{CELL}"' if wanted == 2 and state == HOME else ""
    return f"+{name}: {state}{place}"


def _registration(name: str, attribute: str) -> Handler:
    def handle(radio: Radio, form: str) -> Reply:
        if form == "=?":
            return Reply([f"+{name}: (0-2)"])
        if form != "?":
            setattr(radio.state, attribute, number(form[1:], 0, 1, 2))
            return Reply()
        wanted = getattr(radio.state, attribute)
        told = registration_notice(name, wanted, registration_state(radio)).partition(": ")[2]
        return Reply([f"+{name}: {wanted},{told}"])

    return handle


def _operator(radio: Radio, form: str) -> Reply:
    if form == "?":
        if not radio.registered:
            return Reply(["+COPS: 0"])
        wanted = radio.state.operator_format
        name = "26201" if wanted == 2 else radio.state.write(radio.operator)
        return Reply([f'+COPS: 0,{wanted},"{name}"'])
    if form == "=?":
        return Reply([f'+COPS: (2,"{radio.operator}","{radio.operator[:8]}","26201"),,(0-4),(0-2)'])
    told = words(form[1:])
    mode = number(told[0], 0, 1, 2, 3, 4) if told else 0
    if mode == 3:
        radio.state.operator_format = number(told[1], 0, 1, 2) if len(told) == 2 else 0
    return Reply()


def _signal(radio: Radio, form: str) -> Reply:
    return Reply(["+CSQ: (0-31,99),(0-7,99)"] if form == "=?" else [f"+CSQ: {radio.signal()},0"])


def _function(radio: Radio, form: str) -> Reply:
    if form == "?":
        return Reply([f"+CFUN: {radio.state.functional}"])
    if form == "=?":
        return Reply(["+CFUN: (0,1,4),(0,1)"])
    told = words(form[1:])
    wanted = number(told[0] if told else "", 0, 1, 4)
    if len(told) > 1 and number(told[1], 0, 1) == 1:
        radio.restart()
    else:
        radio.state.functional = wanted
    return Reply()


def _of_sim(tell: Callable[[EmulatedSim], list[str]]) -> Handler:
    def handle(radio: Radio, form: str) -> Reply:
        require_sim(radio)
        return Reply(tell(radio.sim))

    return handle


def _caller(radio: Radio, form: str) -> Reply:
    if form == "?":
        return Reply([f"+CLIP: {int(radio.state.caller_shown)},1"])
    radio.state.caller_shown = bool(number(form[1:], 0, 1))
    return Reply()


def _attached(radio: Radio, form: str) -> Reply:
    return Reply([f"+CGATT: {int(radio.registered)}"] if form == "?" else [])


GENERAL: dict[str, Handler] = {
    "+CGMI": _tells(MAKER), "+GMI": _tells(MAKER), "+CGMM": _tells(MODEL), "+GMM": _tells(MODEL),
    "+CGMR": _tells(REVISION), "+GMR": _tells(REVISION), "+CGSN": _tells(SERIAL), "+GSN": _tells(SERIAL),
    "+GCAP": _tells("+GCAP: +FCLASS,+CGSM"), "+IPR": _tells("+IPR: 0"), "+CPAS": _tells("+CPAS: 0"),
    "+CIMI": _of_sim(lambda sim: [sim.imsi]), "+CNUM": _of_sim(lambda sim: [f'+CNUM: "","{sim.number}",145']),
    "+CMEE": _errors, "+CPIN": _pin, "+SPIC": _tries, "+CSCS": _charset, "+COPS": _operator, "+CSQ": _signal,
    "+CREG": _registration("CREG", "registration"), "+CGREG": _registration("CGREG", "packet_registration"),
    "+CFUN": _function, "+CLIP": _caller, "+CGATT": _attached, "+CRC": _tells(),
}  # fmt: skip
LTE: dict[str, Handler] = {"+CEREG": _registration("CEREG", "lte_registration")}
