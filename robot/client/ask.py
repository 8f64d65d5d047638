"""How the faces of this machine ask a robot: one request over its control socket."""

from __future__ import annotations

import http.client
import json
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot.errors import UnavailableError

ANSWER_S = 35.0  # longer than the longest verb


@dataclass(frozen=True, slots=True)
class Answer:
    """``status`` as in HTTP; ``body`` the JSON object, or {"text": ...} of what is none."""

    status: int
    body: Mapping[str, Any]

    @property
    def ok(self) -> bool:
        return self.status == 200

    @property
    def error(self) -> str:
        return str(self.body.get("error", "")) or f"the robot answered with status {self.status}"


def ask(path: Path, method: str, place: str, body: Mapping[str, object] | None = None) -> Answer:
    """Ask and wait for the answer. ``UnavailableError`` when there is no robot, or none that answers in time."""
    connection = _UnixConnection(path, ANSWER_S)
    try:
        text = None if body is None else json.dumps(body)
        connection.request(method, place, text, {"Content-Type": "application/json"} if text else {})
        response = connection.getresponse()
        content = response.read().decode("utf-8", "replace")
    except (OSError, http.client.HTTPException) as error:
        raise UnavailableError(
            f"no robot answers at {path} ({error or type(error).__name__}); start one with 'sprayer run'"
        ) from error
    finally:
        connection.close()
    try:
        values = json.loads(content)
    except ValueError:
        values = None
    return Answer(response.status, values if isinstance(values, dict) else {"text": content})


class _UnixConnection(http.client.HTTPConnection):
    def __init__(self, path: Path, timeout_s: float) -> None:
        super().__init__("localhost", timeout=timeout_s)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(self.timeout)
        self.sock.connect(os.fspath(self._path))
