"""Text messages as PDUs: published vectors both ways, and whatever bytes may come."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.modem import gsm7
from drivers.modem.pdu import (
    Deliver,
    StatusReport,
    Submit,
    decode_deliver,
    decode_status_report,
    decode_submit,
    encode_deliver,
    encode_status_report,
    encode_submit,
)
from drivers.modem.pdu_fields import encode_validity, validity_of
from drivers.modem.user_data import Alphabet, Part

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared"))
VECTORS = SHARED / "data" / "vectors" / "sms_pdu.json"
needs_vectors = pytest.mark.skipif(not VECTORS.exists(), reason=f"no packets at {VECTORS} (SPRAYER_SHARED)")

SENT = datetime(2026, 6, 15, 10, 0, 7, tzinfo=UTC)
NUMBERS = st.from_regex(r"\+?[0-9*#]{1,20}", fullmatch=True)
GSM_CHARACTERS = [chr(code) for code in range(0x3000) if gsm7.width(chr(code))]
GSM_TEXTS = st.text(GSM_CHARACTERS, max_size=80)
UCS2_TEXTS = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=66)


def vectors(*kinds: str) -> list[dict[str, Any]]:
    return [vector for vector in json.loads(VECTORS.read_text()) if vector["kind"] in kinds]


@needs_vectors
def test_published_submits_decode_and_encode_to_the_octet() -> None:
    told = vectors("submit")
    assert len(told) == 5
    for vector in told:
        submit = decode_submit(vector["pdu"])
        assert submit.text == vector["python_gsmmodem"]["text"] == vector.get("text", submit.text)
        assert submit.number == vector.get("da", vector["python_gsmmodem"]["number"])
        pdu, octets = encode_submit(submit)
        assert pdu == vector["pdu"]
        assert octets == vector.get("cmgs", octets)


@needs_vectors
def test_published_delivers_decode_and_encode_again() -> None:
    for vector in vectors("deliver"):
        deliver = decode_deliver(vector["pdu"])
        assert (deliver.text, deliver.sender, deliver.smsc) == (vector["text"], vector["sender"], vector["smsc"])
        assert deliver.sent_utc == datetime(1999, 3, 29, 13, 16, 59, tzinfo=UTC)
        assert decode_deliver(encode_deliver(deliver)[0]) == deliver


@needs_vectors
def test_published_septets_unpack_and_pack_to_the_octet() -> None:
    told = vectors("gsm7")
    assert len(told) == 8
    for vector in told:
        septets = gsm7.septets_of(vector["text"])
        data = bytes.fromhex(vector["hex"])
        assert gsm7.pack(septets) == data
        assert gsm7.text_of(gsm7.unpack(data, len(septets))) == vector["text"]


@needs_vectors
def test_published_ucs2_texts_travel_both_ways() -> None:
    for vector in vectors("ucs2"):
        pdu, _ = encode_deliver(Deliver("+4917", vector["text"], SENT, Alphabet.UCS2))
        assert pdu.endswith(vector["hex"])
        assert decode_deliver(pdu).text == vector["text"]


@needs_vectors
def test_published_truncated_pdu_is_an_error() -> None:
    for vector in vectors("truncated"):
        with pytest.raises(ValueError, match="ends within its text"):
            decode_submit("00" + vector["tpdu"])


@pytest.mark.parametrize(("text", "octets"), [("hello", 17), ("€", 14), ("[]", 16), ("", 12)])
def test_the_length_leaves_the_service_centre_out(text: str, octets: int) -> None:
    plain, told = encode_submit(Submit("+4917012345", text))
    with_smsc, same = encode_submit(Submit("+4917012345", text, smsc="+491710760000"))
    assert told == same == len(plain) // 2 - 1 == octets
    assert with_smsc.startswith("0791947101670000")


def test_every_septet_has_its_character_and_back() -> None:
    assert len(GSM_CHARACTERS) == 127 + 10
    for character in GSM_CHARACTERS:
        assert gsm7.text_of(gsm7.septets_of(character)) == character


def test_unknown_escapes_show_the_default_character() -> None:
    assert gsm7.text_of([gsm7.ESCAPE, ord("a"), gsm7.ESCAPE]) == "a "
    assert gsm7.text_of([gsm7.ESCAPE, gsm7.ESCAPE, 0x65]) == " e"


@given(NUMBERS, GSM_TEXTS, st.booleans(), st.integers(0, 255), st.one_of(st.none(), st.integers(0, 255)))
def test_any_submit_in_the_gsm_alphabet_comes_back(
    number: str, text: str, report: bool, reference: int, validity: int | None
) -> None:
    seconds = None if validity is None else validity_of(validity)
    submit = Submit(number, text, reference=reference, report=report, validity_s=seconds)
    assert decode_submit(encode_submit(submit)[0]) == submit


@given(NUMBERS, UCS2_TEXTS, st.booleans(), st.integers(0, 255), st.data())
def test_any_part_in_ucs2_comes_back(sender: str, text: str, wide: bool, reference: int, data: st.DataObject) -> None:
    total = data.draw(st.integers(1, 255))
    part = Part(reference, total, data.draw(st.integers(1, total)), wide)
    deliver = Deliver(sender, text, SENT, Alphabet.UCS2, part, "+491710760000")
    assert decode_deliver(encode_deliver(deliver)[0]) == deliver


@given(st.text(GSM_CHARACTERS, max_size=76), st.booleans())
def test_any_part_in_septets_comes_back(text: str, wide: bool) -> None:
    deliver = Deliver("+4917", text, SENT, Alphabet.GSM7, Part(7, 3, 2, wide))
    assert decode_deliver(encode_deliver(deliver)[0]) == deliver


@given(
    st.datetimes(datetime(1990, 1, 1), datetime(2089, 12, 30)).map(lambda moment: moment.replace(microsecond=0)),  # noqa: DTZ001
    st.integers(-79, 79),
)
def test_any_stamp_in_any_zone_comes_back_as_the_same_moment(moment: datetime, quarters: int) -> None:
    local = moment.replace(tzinfo=timezone(timedelta(minutes=15 * quarters)))
    told = decode_deliver(encode_deliver(Deliver("1", "x", local))[0]).sent_utc
    assert told == local
    assert told is not None
    assert told.tzinfo is UTC


def test_a_stamp_west_of_greenwich_is_told_in_utc() -> None:
    west = datetime(2026, 6, 15, 3, 30, tzinfo=timezone(timedelta(hours=-7)))
    pdu, _ = encode_deliver(Deliver("1", "x", west))
    assert decode_deliver(pdu).sent_utc == datetime(2026, 6, 15, 10, 30, tzinfo=UTC)


def test_a_stamp_that_is_no_date_does_not_cost_the_text() -> None:
    pdu, _ = encode_deliver(Deliver("+4917", "STOP", SENT))
    odd = pdu.replace("62605101007000", "FF605101007000")
    assert odd != pdu
    deliver = decode_deliver(odd)
    assert (deliver.text, deliver.sent_utc) == ("STOP", None)


@pytest.mark.parametrize("name", ["Vodafone", "A", "Bank Ltd€", "SPRAYER 007"])
def test_a_named_sender_is_told_by_its_name(name: str) -> None:
    assert decode_deliver(encode_deliver(Deliver(name, "x", SENT))[0]).sender == name


def test_a_national_number_stays_as_it_is_dialled() -> None:
    assert decode_submit(encode_submit(Submit("0170123456", "x"))[0]).number == "0170123456"


@pytest.mark.parametrize("status", [0x00, 0x21, 0x46])
def test_a_status_report_comes_back(status: int) -> None:
    report = StatusReport(17, "+4917012345", status, SENT, SENT + timedelta(seconds=9), "+4917")
    told = decode_status_report(encode_status_report(report)[0])
    assert told == report
    assert told.delivered == (status == 0)
    assert told.final == (status != 0x21)


def test_validity_is_never_shorter_than_asked() -> None:
    for seconds in (1.0, 300.0, 301.0, 43_201.0, 86_401.0, 2_592_001.0, 38_102_400.0):
        assert validity_of(encode_validity(seconds)) >= seconds
    assert [validity_of(code) for code in (0, 143, 144, 167, 168, 196, 197, 255)] == [
        300, 43_200, 45_000, 86_400, 172_800, 2_592_000, 3_024_000, 38_102_400
    ]  # fmt: skip
    with pytest.raises(ValueError, match="validity"):
        encode_validity(1e9)


@pytest.mark.parametrize(
    ("pdu", "reason"),
    [
        ("", "service centre"),
        ("0", "hexadecimal"),
        ("zz", "hexadecimal"),
        ("00" * 300, "at most 255"),
        ("0004FF9171", "at most 20"),
        ("0004029121000062605101007000FF", "at most 140"),
        ("00040291210008626051010070000300310032", "ends within its text|odd number"),
        ("0004029121002062605101007000026162", "compressed"),
        ("0004029121000462605101007000016162", "more octets"),
        ("004402912100046260510100700003056162", "header"),
        ("00440291210004626051010070000302000361", "cut short|ends within"),
        ("000102912100046260510100700001", "another kind"),
    ],
)
def test_a_hostile_pdu_is_refused_with_its_reason(pdu: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        decode_deliver(pdu)


@given(st.binary(max_size=300))
def test_any_octets_decode_or_say_why_not(data: bytes) -> None:
    for decode in (decode_deliver, decode_submit, decode_status_report):
        for pdu in (data.hex(), "00" + data.hex(), "0004" + data.hex(), "0040" + data.hex()):
            with suppress(ValueError):
                decode(pdu)


@given(st.text(max_size=400))
def test_any_text_decodes_or_says_why_not(text: str) -> None:
    for decode in (decode_deliver, decode_submit, decode_status_report):
        with pytest.raises(ValueError, match=r"."):
            decode("0004" + text + "!")


@given(st.data())
def test_a_pdu_cut_anywhere_is_an_error(data: st.DataObject) -> None:
    text = data.draw(st.text(GSM_CHARACTERS, min_size=1, max_size=70))
    pdu, _ = encode_deliver(Deliver("+4917012345", text, SENT))
    end = data.draw(st.integers(0, len(pdu) - 1))
    with pytest.raises(ValueError, match=r"."):
        decode_deliver(pdu[:end])


@pytest.mark.parametrize("number", ["", "1" * 21, "+" + "1" * 21, "имя", "a name of many letters"])
def test_a_number_that_cannot_be_is_refused(number: str) -> None:
    with pytest.raises(ValueError, match=r"number|alphabet"):
        encode_submit(Submit(number, "x"))
