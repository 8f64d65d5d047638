"""Long texts torn and joined."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.modem.concatenation import LONGEST_CHARACTERS, Joiner, Whole, split
from drivers.modem.pdu import Deliver, decode_deliver, encode_deliver
from drivers.modem.user_data import Alphabet, Part
from tests.drivers.modem.test_pdu import GSM_CHARACTERS

SENT = datetime(2026, 6, 15, 10, 0, tzinfo=UTC)
ANY_TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=LONGEST_CHARACTERS)
GSM_TEXT = st.text([*GSM_CHARACTERS, "€", "["], max_size=LONGEST_CHARACTERS)


def delivers(text: str, reference: int = 7, sender: str = "+4917", wide: bool = False) -> list[Deliver]:
    alphabet, parts = split(text, wide)
    return [
        Deliver(sender, piece, SENT, alphabet, Part(reference, len(parts), number, wide) if len(parts) > 1 else None)
        for number, piece in enumerate(parts, start=1)
    ]


@pytest.mark.parametrize(
    ("text", "alphabet", "lengths"),
    [
        ("", Alphabet.GSM7, [0]),
        ("a" * 160, Alphabet.GSM7, [160]),
        ("a" * 161, Alphabet.GSM7, [153, 8]),
        ("€" * 80, Alphabet.GSM7, [80]),
        ("a" + "€" * 80, Alphabet.GSM7, [77, 4]),
        ("ж" * 70, Alphabet.UCS2, [70]),
        ("ж" * 71, Alphabet.UCS2, [67, 4]),
        ("😀" * 35, Alphabet.UCS2, [35]),
        ("😀" * 36, Alphabet.UCS2, [33, 3]),
        ("a" * 1530, Alphabet.GSM7, [153] * 10),
    ],
)
def test_a_text_takes_the_fewest_parts(text: str, alphabet: Alphabet, lengths: list[int]) -> None:
    told, parts = split(text)
    assert told is alphabet
    assert [len(part) for part in parts] == lengths


@given(st.one_of(ANY_TEXT, GSM_TEXT), st.booleans(), st.randoms())
def test_any_text_comes_back_whole_in_any_order_of_its_parts(text: str, wide: bool, dice: object) -> None:
    pdus = [encode_deliver(deliver)[0] for deliver in delivers(text, wide=wide)]
    if len(pdus) == 1:
        assert decode_deliver(pdus[0]).text == text
        return
    dice.shuffle(pdus)  # type: ignore[attr-defined]
    joiner: Joiner[str] = Joiner(60.0)
    wholes: list[Whole[str]] = []
    for pdu in pdus:
        whole, dropped = joiner.add(decode_deliver(pdu), pdu, 0.0)
        assert not dropped
        wholes += [whole] if whole else []
    assert [whole.text for whole in wholes] == [text]
    assert sorted(wholes[0].sources) == sorted(pdus)
    assert not joiner.waiting


def test_a_text_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="at most 1530 characters, found 1531"):
        split("a" * 1531)
    with pytest.raises(ValueError, match="surrogate"):
        split("\ud83d")


def test_a_pair_torn_apart_by_its_sender_is_mended() -> None:
    joiner: Joiner[int] = Joiner(60.0)
    halves = "😀".encode("utf-16-be").decode("utf-16-be", "surrogatepass").encode("utf-16-be")
    first, second = (halves[:2].decode("utf-16-be", "surrogatepass"), halves[2:].decode("utf-16-be", "surrogatepass"))
    joiner.add(Deliver("1", "a" + first, SENT, Alphabet.UCS2, Part(1, 2, 1)), 1, 0.0)
    whole, _ = joiner.add(Deliver("1", second + "b", SENT, Alphabet.UCS2, Part(1, 2, 2)), 2, 0.0)
    assert whole is not None
    assert whole.text == "a😀b"


def test_texts_of_two_senders_with_one_reference_do_not_mix() -> None:
    joiner: Joiner[str] = Joiner(60.0)
    ours, theirs = delivers("a" * 200, sender="+1"), delivers("b" * 200, sender="+2")
    assert joiner.add(ours[0], "a1", 0.0) == (None, ())
    assert joiner.add(theirs[1], "b2", 0.0) == (None, ())
    whole, _ = joiner.add(ours[1], "a2", 0.0)
    assert whole is not None
    assert whole.text == "a" * 200
    assert joiner.waiting == ("b2",)


def test_a_part_that_comes_twice_counts_once() -> None:
    joiner: Joiner[str] = Joiner(60.0)
    first, second = delivers("a" * 200)
    joiner.add(first, "one", 0.0)
    assert joiner.add(first, "again", 0.0) == (None, ("again",))
    whole, _ = joiner.add(second, "two", 0.0)
    assert whole is not None
    assert whole.sources == ("one", "two")


def test_a_reference_in_use_again_puts_the_old_parts_out_of_use() -> None:
    joiner: Joiner[str] = Joiner(60.0)
    joiner.add(delivers("a" * 200)[0], "old", 0.0)
    new = delivers("b" * 200)
    assert joiner.add(new[0], "new1", 9.0) == (None, ("old",))
    whole, _ = joiner.add(new[1], "new2", 9.0)
    assert whole is not None
    assert whole.text == "b" * 200


def test_parts_do_not_wait_for_ever() -> None:
    joiner: Joiner[str] = Joiner(60.0)
    joiner.add(delivers("a" * 200)[0], "one", 0.0)
    assert joiner.expire(60.0) == ()
    assert joiner.expire(60.1) == (("one",),)
    assert joiner.waiting == ()


def test_more_unfinished_texts_than_there_is_room_for_cost_the_oldest() -> None:
    joiner: Joiner[int] = Joiner(1e9, most_groups=3)
    dropped = [joiner.add(delivers("a" * 200, reference)[0], reference, float(reference))[1] for reference in range(5)]
    assert dropped == [(), (), (), (0,), (1,)]
    assert joiner.waiting == (2, 3, 4)


def test_the_oldest_stamp_counts_and_a_missing_one_is_told() -> None:
    joiner: Joiner[int] = Joiner(60.0)
    first, second = delivers("a" * 200)
    joiner.add(Deliver("1", first.text, SENT + timedelta(seconds=5), first.alphabet, first.part), 1, 0.0)
    whole, _ = joiner.add(Deliver("1", second.text, SENT, second.alphabet, second.part), 2, 0.0)
    assert whole is not None
    assert whole.sent_utc == SENT
    joiner.add(Deliver("1", first.text, None, first.alphabet, first.part), 1, 0.0)
    whole, _ = joiner.add(Deliver("1", second.text, SENT, second.alphabet, second.part), 2, 0.0)
    assert whole is not None
    assert whole.sent_utc is None
