"""The controls of a camera whose stream comes over HTTP, at ``controls`` beside the stream.

GET gives {name: {"value": v, "low": l, "high": h, "step": s}}; POST {name: value} sets and answers like GET.
"""

from __future__ import annotations

import http.client
import json
import urllib.error
import urllib.request
from typing import Any
from urllib.parse import urljoin

from drivers.camera.controls import Control, Limits
from drivers.errors import DeviceFault

_PATIENCE_S = 1.0
_LONGEST_ANSWER = 65536


class HttpControls:
    """Implements ``Controls`` for the stream at ``url``. A camera that has none (404) has no controls at all."""

    def __init__(self, url: str) -> None:
        self._url = urljoin(url, "controls")
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        self._limits: dict[str, Limits] = {}
        self._values: dict[str, float] = {}
        self._exchange(None)

    def limits(self, control: Control) -> Limits | None:
        return self._limits.get(control)

    def read(self, control: Control) -> float:
        self._exchange(None)
        return self._values[control]

    def write(self, control: Control, value: float) -> None:
        self._exchange({str(control): value})

    def close(self) -> None:
        """Nothing stays open."""

    def _exchange(self, wanted: dict[str, float] | None) -> None:
        body = None if wanted is None else json.dumps(wanted).encode()
        request = urllib.request.Request(self._url, data=body, headers={"Content-Type": "application/json"})
        try:
            with self._opener.open(request, timeout=_PATIENCE_S) as answer:
                self._understand(json.loads(answer.read(_LONGEST_ANSWER)))
        except urllib.error.HTTPError as error:
            with error:
                if error.code == 404 and wanted is None:
                    return
            raise DeviceFault(
                "camera", f"{self._url} to set {wanted}", f"HTTP {error.code}", "check the controls of the stream"
            ) from error
        except (http.client.HTTPException, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DeviceFault(
                "camera", f"controls as JSON from {self._url}", f"something else ({error})", "check the stream's server"
            ) from error

    def _understand(self, described: dict[str, dict[str, Any]]) -> None:
        for name, about in described.items():
            self._limits[name] = Limits(float(about["low"]), float(about["high"]), float(about["step"]))
            self._values[name] = float(about["value"])
