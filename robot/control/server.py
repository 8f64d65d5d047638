"""The API over HTTP on a Unix socket: what is asked, in JSON, and what is answered."""

from __future__ import annotations

import asyncio
import difflib
import logging
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import asdict
from typing import Any

from aiohttp import web

from drivers.errors import DeviceError
from robot.control.confirming import TOKEN_LIVES_S, Offers
from robot.control.machine import Declined, Machine, TaskChoice
from robot.control.metrics import CONTENT_TYPE, metrics_text
from robot.control.requests import BODY_MAX_BYTES, Malformed, fields_of, number_field, text_field
from robot.control.socket_file import ControlSocket
from robot.errors import SprayerError
from robot.logs import fields

LONGEST_CONNECTION_S = 30.0  # a connection is good for one request, whatever its client does
CONNECTIONS_MAX = 32
IDLE_S = 5.0    # for the request to begin
LINGER_S = 0.5  # for the rest of a request that was answered already
STOP_BODY_S = 0.05  # how long a stop waits to learn its cause
SHUTDOWN_S = 0.5
BY_API = "over the control socket"
STOP_CAUSE = f"STOP {BY_API}"

_log = logging.getLogger(__name__)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@asynccontextmanager
async def serve(machine: Machine, listening: ControlSocket) -> AsyncIterator[None]:
    """Answer at the socket for as long as the block lasts. Needs a loop in real time."""
    loop = asyncio.get_running_loop()
    runner = web.AppRunner(
        Api(machine, loop.time).application(),
        access_log=None,
        shutdown_timeout=SHUTDOWN_S,
        keepalive_timeout=IDLE_S,
        lingering_time=LINGER_S,
    )
    await runner.setup()
    assert runner.server is not None
    server = await loop.create_unix_server(_Connections(runner.server), sock=listening.listening)
    try:
        yield
    finally:
        server.close()
        await runner.cleanup()


class _Connections:
    """Makes the protocol of each new connection, bounds its life, and lets the oldest go when there are too many."""

    def __init__(self, server: web.Server) -> None:
        self._server = server

    def __call__(self) -> asyncio.Protocol:
        present = self._server.connections
        for oldest in present[: max(0, len(present) - CONNECTIONS_MAX + 1)]:
            _abort(oldest)
        protocol = self._server()
        asyncio.get_running_loop().call_later(LONGEST_CONNECTION_S, _abort, protocol)
        return protocol


def _abort(protocol: web.RequestHandler) -> None:
    transport = protocol.transport
    if isinstance(transport, asyncio.WriteTransport):
        transport.abort()


class Api:
    """Version 1. Verbs are done one after another; a stop waits for none of them."""

    def __init__(self, machine: Machine, clock: Callable[[], float]) -> None:
        self._machine = machine
        self._offers = Offers(clock)
        self._one_verb = asyncio.Lock()
        self._routes: dict[tuple[str, str], Handler] = {
            ("GET", "/v1/status"): self._status,
            ("GET", "/metrics"): self._metrics,
            ("POST", "/v1/stop"): self._stop,
            ("POST", "/v1/start"): self._start,
            ("POST", "/v1/arm"): self._verb(machine.arm),
            ("POST", "/v1/pause"): self._verb(machine.pause),
            ("POST", "/v1/resume"): self._verb(machine.resume),
            ("POST", "/v1/acknowledge"): self._verb(machine.acknowledge),
            ("POST", "/v1/reset"): self._verb(machine.reset),
            ("POST", "/v1/disarm"): self._verb(machine.disarm),
            ("POST", "/v1/refill"): self._refill,
        }

    def application(self) -> web.Application:
        application = web.Application(client_max_size=BODY_MAX_BYTES)
        application.router.add_route("*", "/{path:.*}", self._answer)
        return application

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        try:
            response = await self._route(request)(request)
        except Malformed as error:
            response = _refusal(error.status, str(error))
        except web.HTTPRequestEntityTooLarge:
            response = _refusal(413, f"the body is larger than {BODY_MAX_BYTES} bytes; send less")
        except Declined as error:
            response = _refusal(409, str(error), error.reasons)
        except (SprayerError, DeviceError) as error:
            response = _refusal(409, str(error), (str(error),))
        response.force_close()
        return response

    def _route(self, request: web.Request) -> Handler:
        handler = self._routes.get((request.method, request.path))
        if handler is not None:
            return handler
        methods = sorted({method for method, path in self._routes if path == request.path})
        if methods:
            raise Malformed(f"{request.path}: expected {methods[0]}, found {request.method}", 405)
        paths = sorted({path for _, path in self._routes})
        near = difflib.get_close_matches(request.path, paths, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"there is {', '.join(paths)}"
        raise Malformed(f"there is no '{request.path}'; {hint}", 404)

    async def _status(self, _request: web.Request) -> web.StreamResponse:
        status = await self._machine.status()
        return web.json_response({"version": 1, **_plain(asdict(status))})

    async def _metrics(self, _request: web.Request) -> web.StreamResponse:
        machine = self._machine
        text = metrics_text(await machine.status(), machine.lateness(), machine.ports())
        return web.Response(body=text, headers={"Content-Type": CONTENT_TYPE})

    async def _stop(self, request: web.Request) -> web.StreamResponse:
        """Whatever is sent along, and however it is malformed, the machine stops."""
        cause, note = STOP_CAUSE, ""
        try:
            async with asyncio.timeout(STOP_BODY_S):
                cause = text_field(await fields_of(request, ("cause",)), "cause", STOP_CAUSE)
        except (Malformed, web.HTTPException) as error:
            note = f"stopped, though: {error}"
        except (TimeoutError, OSError):
            note = "stopped without waiting for the rest of the request"
        _log.info("asked to stop", extra=fields(cause=cause))
        parts = await asyncio.shield(asyncio.ensure_future(self._machine.stop(cause)))
        answer: dict[str, Any] = {"parts": [asdict(part) for part in parts]}
        return web.json_response(answer | ({"note": note} if note else {}))

    async def _start(self, request: web.Request) -> web.StreamResponse:
        """Without ``confirm`` a plan and its token; with it, what was planned begins."""
        values = await fields_of(request, ("task", "confirm", "cause"))
        cause = text_field(values, "cause", f"start {BY_API}")
        token = text_field(values, "confirm", "")
        async with self._one_verb:
            if not token:
                plan = await self._machine.plan(_choice(values))
                summary = {"summary": plan.summary(), **_plain(asdict(plan))}
                token = self._offers.make(plan)
                return web.json_response({"plan": summary, "token": token, "expires_s": TOKEN_LIVES_S})
            if "task" in values:
                raise Malformed("'task' belongs to the request for a plan, not to its confirmation; leave it out")
            plan = self._offers.take(token)
            _log.info("start confirmed", extra=fields(cause=cause, plan=plan.summary()))
            return web.json_response({"task": await self._machine.start(plan, cause)})

    async def _refill(self, request: web.Request) -> web.StreamResponse:
        values = await fields_of(request, ("tank_ml", "cause"))
        tank_ml, cause = number_field(values, "tank_ml"), text_field(values, "cause", f"refill {BY_API}")
        async with self._one_verb:
            await self._machine.refill(tank_ml, cause)
            status = await self._machine.status()
        _log.info("refill", extra=fields(cause=cause, tank_ml=tank_ml))
        return web.json_response({"mode": status.mode, "causes": status.causes, "tank_ml": tank_ml})

    def _verb(self, verb: Callable[[str], Awaitable[None]]) -> Handler:
        async def handle(request: web.Request) -> web.StreamResponse:
            name = request.path.rpartition("/")[2]
            cause = text_field(await fields_of(request, ("cause",)), "cause", f"{name} {BY_API}")
            async with self._one_verb:
                await verb(cause)
                status = await self._machine.status()
            _log.info("%s", name, extra=fields(cause=cause, mode=status.mode))
            return web.json_response({"mode": status.mode, "causes": status.causes})

        return handle


def _choice(values: Mapping[str, object]) -> TaskChoice:
    text = text_field(values, "task", TaskChoice.AUTO)
    try:
        return TaskChoice(text)
    except ValueError:
        raise Malformed(f"'task': expected {', '.join(TaskChoice)}, found '{text}'") from None


def _refusal(status: int, text: str, reasons: tuple[str, ...] = ()) -> web.StreamResponse:
    return web.json_response({"error": text} | ({"reasons": list(reasons)} if reasons else {}), status=status)


def _plain(value: Any) -> Any:
    """As JSON can hold it: what is not finite becomes null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
