"""Long texts in parts: torn apart so that no character breaks, and put together again as their parts come in."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from datetime import datetime
from typing import Generic, TypeVar

from drivers.modem import gsm7
from drivers.modem.pdu import Deliver
from drivers.modem.user_data import Alphabet, joined_text

LONGEST_CHARACTERS = 1530
_SINGLE = {Alphabet.GSM7: 160, Alphabet.UCS2: 70}
_EACH = {Alphabet.GSM7: 153, Alphabet.UCS2: 67}
_EACH_WIDE = {Alphabet.GSM7: 152, Alphabet.UCS2: 66}

Source = TypeVar("Source", bound=Hashable)


def alphabet_for(text: str) -> Alphabet:
    """The narrowest alphabet that can write the text."""
    return Alphabet.GSM7 if all(gsm7.width(character) for character in text) else Alphabet.UCS2


def split(text: str, wide: bool = False, longest: int = LONGEST_CHARACTERS) -> tuple[Alphabet, tuple[str, ...]]:
    """The alphabet and the parts, one when the text fits in one. ``wide``: for references of 16 bits.

    Raises ``ValueError`` for a text of more than ``longest`` characters or with half a surrogate pair.
    """
    if len(text) > longest:
        raise ValueError(f"expected a text of at most {longest} characters, found {len(text)}")
    for character in text:
        if 0xD800 <= ord(character) < 0xE000:
            raise ValueError("expected whole characters, found half a surrogate pair")
    alphabet = alphabet_for(text)
    if sum(_width(character, alphabet) for character in text) <= _SINGLE[alphabet]:
        return alphabet, (text,)
    room = (_EACH_WIDE if wide else _EACH)[alphabet]
    parts: list[str] = []
    begin = used = 0
    for at, character in enumerate(text):
        width = _width(character, alphabet)
        if used + width > room:
            parts.append(text[begin:at])
            begin, used = at, 0
        used += width
    return alphabet, (*parts, text[begin:])


def _width(character: str, alphabet: Alphabet) -> int:
    if alphabet is Alphabet.GSM7:
        return gsm7.width(character)
    return 2 if ord(character) > 0xFFFF else 1


@dataclass(frozen=True, slots=True)
class Whole(Generic[Source]):
    """A text whose parts are all there. ``sent_utc`` is the oldest stamp, None when a part has none."""

    sender: str
    text: str
    sent_utc: datetime | None
    sources: tuple[Source, ...]


@dataclass(slots=True)
class _Group(Generic[Source]):
    since_s: float
    parts: dict[int, tuple[Deliver, Source]] = field(default_factory=dict)


class Joiner(Generic[Source]):
    """Parts that wait for the others of their text, for ``keep_s`` at most; ``source`` says where each lies."""

    def __init__(self, keep_s: float, most_groups: int = 32) -> None:
        self._keep_s, self._most_groups = keep_s, most_groups
        self._groups: dict[tuple[str, int, bool, int], _Group[Source]] = {}

    def add(self, deliver: Deliver, source: Source, now_s: float) -> tuple[Whole[Source] | None, tuple[Source, ...]]:
        """The whole text if this was its last part; and the sources of parts that this one has put out of use."""
        part = deliver.part
        assert part is not None, "a text in one piece needs no joining"
        key = (deliver.sender, part.reference, part.wide, part.total)
        group = self._groups.setdefault(key, _Group(now_s))
        dropped: tuple[Source, ...] = ()
        if (held := group.parts.get(part.number)) is not None:
            if held[0].text == deliver.text:
                return None, (source,)
            dropped = tuple(old for _, old in group.parts.values())  # the reference is in use again
            group = self._groups[key] = _Group(now_s)
        group.parts[part.number] = (deliver, source)
        if len(group.parts) < part.total:
            if len(self._groups) > self._most_groups:
                oldest = min(self._groups, key=lambda each: self._groups[each].since_s)
                dropped += tuple(old for _, old in self._groups.pop(oldest).parts.values())
            return None, dropped
        del self._groups[key]
        return _whole(group), dropped

    def expire(self, now_s: float) -> tuple[tuple[Source, ...], ...]:
        """The sources of each text that has waited too long for its other parts."""
        old = [key for key, group in self._groups.items() if now_s - group.since_s > self._keep_s]
        return tuple(tuple(source for _, source in self._groups.pop(key).parts.values()) for key in old)

    @property
    def waiting(self) -> tuple[Source, ...]:
        return tuple(source for group in self._groups.values() for _, source in group.parts.values())


def _whole(group: _Group[Source]) -> Whole[Source]:
    parts = [group.parts[number] for number in sorted(group.parts)]
    stamps = [deliver.sent_utc for deliver, _ in parts]
    known = [stamp for stamp in stamps if stamp is not None]
    return Whole(
        parts[0][0].sender,
        joined_text([deliver.text for deliver, _ in parts]),
        min(known) if len(known) == len(stamps) else None,
        tuple(source for _, source in parts),
    )
