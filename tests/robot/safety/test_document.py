from pathlib import Path

import pytest

from robot.safety import CATALOGUE
from robot.safety.document import fault_table, filled, timing_table

DOCUMENT = Path(__file__).parents[3] / "docs" / "safety.md"


def test_the_document_is_what_the_tables_say():
    text = DOCUMENT.read_text(encoding="utf-8")
    assert filled(text) == text


def test_another_table_in_the_document_is_replaced():
    text = DOCUMENT.read_text(encoding="utf-8")
    assert filled(text.replace("| F01 | relay board unplugged", "| F01 | something else")) == text


def test_every_fault_has_one_row():
    rows = fault_table().splitlines()[2:]
    assert [row.split(" | ")[0].removeprefix("| ") for row in rows] == [kind.id for kind in CATALOGUE]


def test_values_have_their_units():
    table = timing_table()
    assert "| `LEASE_LOST_S` | 0.5 s |" in table
    assert "| `BASE_STILL_M_S` | 0.01 m/s |" in table
    assert "| `TILT_MAX_RAD` | 0.26 rad |" in table
    assert "| `CLOSE_TRIES` | 3 |" in table


def test_a_document_without_the_marks_is_an_error():
    with pytest.raises(ValueError):
        filled("no marks")
