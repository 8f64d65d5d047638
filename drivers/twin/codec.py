"""Frozen dataclasses to JSON values and back, by their type hints; numbers survive to the last bit."""

from __future__ import annotations

import functools
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime
from enum import Enum
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

T = TypeVar("T")


def encode(value: object) -> Any:
    """A JSON value of a dataclass, array, enum, time or container of them."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: encode(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Mapping):
        return {str(encode(key)): encode(item) for key, item in value.items()}
    if isinstance(value, frozenset):
        return sorted(encode(item) for item in value)
    if isinstance(value, tuple | list):
        return [encode(item) for item in value]
    return value


def decode(kind: type[T], data: object) -> T:
    """The dataclass ``kind`` from what ``encode`` made of it. Raises ``ValueError`` for a missing or unknown key."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{kind.__name__}: expected an object, found {type(data).__name__}")  # noqa: TRY004
    hints = _hints(kind)  # type: ignore[arg-type]  # a class is hashable
    if set(data) != set(hints):
        odd = ", ".join(sorted(set(data) ^ set(hints)))
        raise ValueError(f"{kind.__name__}: missing or unknown keys {odd}")
    return kind(**{name: _value(hint, data[name]) for name, hint in hints.items()})


@functools.cache
def _hints(kind: type[Any]) -> Mapping[str, Any]:
    return get_type_hints(kind)


def _value(hint: Any, data: Any) -> Any:
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return None if data is None else _value(next(part for part in parts if part is not type(None)), data)
    if origin is np.ndarray:
        return np.asarray(data, dtype=np.float64)
    if origin is tuple and len(parts) == 2 and parts[1] is Ellipsis:
        return tuple(_value(parts[0], item) for item in data)
    if origin is tuple:
        return tuple(_value(part, item) for part, item in zip(parts, data, strict=True))
    if origin is frozenset:
        return frozenset(_value(parts[0], item) for item in data)
    if isinstance(hint, type):
        if is_dataclass(hint):
            return decode(hint, data)
        if issubclass(hint, datetime):
            return datetime.fromisoformat(data)
        if issubclass(hint, Enum | float):
            return hint(data)
    return data
