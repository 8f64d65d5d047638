"""What may stand in a request's body: one JSON object of known fields, or nothing."""

from __future__ import annotations

import asyncio
import difflib
import json
import math
from collections.abc import Mapping

from aiohttp import web

BODY_MAX_BYTES = 64 * 1024
BODY_S = 2.0
TEXT_MAX = 300


class Malformed(Exception):
    """The request cannot be meant so; ``status`` is HTTP's."""

    def __init__(self, text: str, status: int = 400) -> None:
        super().__init__(text)
        self.status = status


async def fields_of(request: web.Request, known: tuple[str, ...]) -> Mapping[str, object]:
    """The fields of the body, {} without one. ``Malformed`` for anything but a JSON object of ``known`` fields."""
    try:
        async with asyncio.timeout(BODY_S):
            body = await request.read()
    except TimeoutError:
        raise Malformed(f"the body did not come within {BODY_S:.0f} s; send it with the request", 408) from None
    if not body.strip():
        return {}
    try:
        values = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise Malformed(f"expected a JSON object, found something else ({error})") from None
    if not isinstance(values, dict):
        raise Malformed(f"expected a JSON object, found {type(values).__name__}")
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(known)}"
            raise Malformed(f"unknown field '{name[:TEXT_MAX]}'; {hint}")
    return values


def number_field(values: Mapping[str, object], name: str) -> float:
    """A field that must be there and hold a number; one beyond all bounds is infinite."""
    value = values.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Malformed(f"'{name}': expected a number, found {'nothing' if value is None else type(value).__name__}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def text_field(values: Mapping[str, object], name: str, otherwise: str) -> str:
    """A field that holds one line of text."""
    value = values.get(name, otherwise)
    if not isinstance(value, str) or len(value) > TEXT_MAX or not value.isprintable():
        raise Malformed(f"'{name}': expected one line of text, at most {TEXT_MAX} characters")
    return value
