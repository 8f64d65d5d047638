"""The report of a task: one HTML file to look at, one table for the terminal."""

from robot.report.evidence import Evidence, read_evidence
from robot.report.page import render
from robot.report.score import Judgement, Score, judge
from robot.report.table import kind_rows, ledger_rows, light_rows, light_words, score_rows

__all__ = [
    "Evidence",
    "Judgement",
    "Score",
    "judge",
    "kind_rows",
    "ledger_rows",
    "light_rows",
    "light_words",
    "read_evidence",
    "render",
    "score_rows",
]
