"""The register map and its encodings."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wheels import zlac_registers as r

VECTORS = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared")) / "data/vectors/modbus.json"


@given(st.integers(-(2**15), 2**15 - 1))
def test_a_signed_word_comes_back(value: int) -> None:
    assert r.signed_16(r.word_of(value)) == value


@given(st.integers(-(2**31), 2**31 - 1))
def test_a_counter_comes_back(value: int) -> None:
    assert r.signed_32(*r.words_of(value)) == value


def test_the_high_word_comes_first() -> None:
    assert r.words_of(0x12345678) == (0x1234, 0x5678)
    assert r.words_of(-1) == (0xFFFF, 0xFFFF)


def test_a_speed_beyond_a_word_is_an_error() -> None:
    with pytest.raises(ValueError, match="16-bit"):
        r.word_of(40_000)


@given(st.integers(1, 0xFFFF))
def test_every_fault_word_has_a_name_for_each_of_its_bits(word: int) -> None:
    faults = r.faults_in(word)
    assert sum(fault.bit for fault in faults) == word
    assert all(fault.name and fault.remedy for fault in faults)


def test_no_fault_has_no_name() -> None:
    assert r.faults_in(0) == ()


def test_a_fault_that_no_list_names_tells_its_code() -> None:
    assert r.faults_in(0x8004)[-1].name == "unknown fault 0x8000"


@pytest.mark.skipif(not VECTORS.exists(), reason=f"no vectors at {VECTORS}: put them there or set SPRAYER_SHARED")
def test_the_map_agrees_with_the_public_one() -> None:
    public = json.loads(VECTORS.read_text())["register_maps"]["zlac8015d"]
    told = {int(word, 16) for text in public["regs"].values() for word in re.findall(r"0x2[0-9A-F]{3}", text)}
    not_used = {0x2005, 0x2016, 0x2018}  # clearing the counters, and the input terminals
    assert told - not_used <= r.REGISTERS.keys()
    for code, name in public["faults"].items():
        (fault,) = r.faults_in(int(code, 16))
        assert fault.name.split()[0].lower().replace("-", " ").startswith(name.split()[0].lower())
