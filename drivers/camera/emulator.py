"""The twin's stereo camera as a paced MJPEG stream with controls, for ``stereo_usb`` to read like a UVC camera.

On http://127.0.0.1:PORT: ``/stream`` (both views side by side), ``/left`` and ``/right`` as multipart/x-mixed-replace,
``/controls`` as JSON: GET gives {name: {value, low, high, step}}, POST {name: value} sets and answers like GET.
"""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from aiohttp import web

from drivers.camera.darkroom import Darkroom, Developed, Order
from drivers.camera.emulated_controls import EmulatedControls
from drivers.twin.bus import FAILING_SHARE, SLOW_FACTOR, STALE_S
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

HOST = "127.0.0.1"
_BOUNDARY = "frame"
_GOODBYE_S = 0.2
_IN_FLIGHT_LIMIT = 64


@dataclass(eq=False, slots=True)
class _Viewer:
    """One connected client: the newest frame that it has not been sent yet; None ends the stream."""

    view: str
    request: web.Request
    frames: asyncio.Queue[bytes | None] = field(default_factory=lambda: asyncio.Queue(1))

    def offer(self, frame: bytes | None) -> None:
        if self.frames.full():
            self.frames.get_nowait()
        self.frames.put_nowait(frame)


class CameraEmulator:
    """One camera on one port, which stays the same over ``unplug`` and ``plug``; ``clock`` gives loop time.

    It exposes only while somebody looks. ``serve`` is its life; it also pulls the plug when the fault says so.
    ``right_late_s`` makes the right view of ``/right`` late by so much.
    """

    def __init__(self, twin: Twin, clock: Callable[[], float], darkroom: Darkroom, port: int = 0) -> None:
        self._twin, self._clock, self._darkroom = twin, clock, darkroom
        self._reserved = _socket_on(port)  # never listens: it keeps the port while the camera is unplugged
        self._port = int(self._reserved.getsockname()[1])
        self.controls = EmulatedControls.at_power_on(twin.nominal)
        self.right_late_s = 0.0
        self._viewers: set[_Viewer] = set()
        self._runner: web.AppRunner | None = None
        self._random = np.random.default_rng([twin.seed, 0xCA3])
        self._under_way: set[asyncio.Task[None]] = set()
        self._stuck: dict[str, bytes] = {}
        self._last_pose: object = None
        self._told_pose: object = None
        self._warm = self._pulled = self._developing = False

    @property
    def url(self) -> str:
        """The address of the side-by-side stream."""
        return self.url_of("stream")

    def url_of(self, view: str) -> str:
        """The address of ``stream``, ``left`` or ``right``."""
        return f"http://{HOST}:{self._port}/{view}"

    @property
    def plugged(self) -> bool:
        return self._runner is not None

    @property
    def watched(self) -> bool:
        """Whether somebody is connected to a stream."""
        return bool(self._viewers)

    async def plug(self) -> None:
        """Power on: automatics run, the port answers. The first time waits for the darkroom to be ready."""
        if self._runner is not None:
            return
        if not self._warm:
            nominal = self._twin.nominal
            await self._darkroom.develop(Order(self._twin.shot(self._clock()), nominal.exposure_s, nominal.gain, 0))
            self._warm = True
        self.controls = EmulatedControls.at_power_on(self._twin.nominal)
        application = web.Application()
        for view in ("stream", "left", "right"):
            application.router.add_get(f"/{view}", self._stream)
        application.router.add_get("/controls", self._tell_controls)
        application.router.add_post("/controls", self._set_controls)
        runner = web.AppRunner(application, handle_signals=False, access_log=None, shutdown_timeout=_GOODBYE_S)
        await runner.setup()
        await web.SockSite(runner, _socket_on(self._port)).start()
        self._runner = runner

    async def unplug(self) -> None:
        """Gone from one moment to the next: connections break, the port refuses."""
        runner, self._runner = self._runner, None
        for viewer in self._viewers:
            viewer.offer(None)
            if viewer.request.transport is not None:
                viewer.request.transport.abort()
        if runner is not None:
            await runner.cleanup()

    async def serve(self) -> None:
        """Expose and send, for ever."""
        try:
            while True:
                await self._mind_the_plug()
                await self._expose_next()
        finally:
            for task in self._under_way:
                task.cancel()
            await asyncio.gather(*self._under_way, return_exceptions=True)
            await self.unplug()
            self._reserved.close()
            self._darkroom.close()

    async def _mind_the_plug(self) -> None:
        unplugged = self._verb is Verb.UNPLUGGED
        if unplugged and self.plugged:
            await self.unplug()
            self._pulled = True
        elif not unplugged and self._pulled:
            await self.plug()
            self._pulled = False

    @property
    def _verb(self) -> Verb:
        return self._twin.verb("camera", self._clock())

    async def _expose_next(self) -> None:
        rate_hz = self._twin.nominal.camera_rate_hz
        exposure_s, gain = self.controls["exposure_s"], self.controls["gain"]
        sequence = math.floor(self._clock() * rate_hz + 1e-6) + 1
        begin_s = sequence / rate_hz
        await asyncio.sleep(begin_s + 0.5 * exposure_s - self._clock())
        if self._developing or not self._viewers or self._verb is Verb.OFF or len(self._under_way) > _IN_FLIGHT_LIMIT:
            return
        shot = self._twin.shot(self._clock())
        at_rest, self._last_pose = shot.pose == self._last_pose, shot.pose
        tells = at_rest and shot.pose != self._told_pose and self._twin.truth.keeps
        if tells:
            self._told_pose = shot.pose
        order = Order(
            shot, exposure_s, gain, sequence,
            white_balance_k=None if self.controls["auto_white_balance"] else self.controls["white_balance_k"],
            views=frozenset(viewer.view for viewer in self._viewers),
            swapped=self._verb is Verb.WRONG,
            truth=tells,
        )  # fmt: skip
        self._developing = True  # what would be exposed until the picture is made is lost: a camera does not queue
        task = asyncio.create_task(self._finish(order, begin_s + exposure_s))
        self._under_way.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._under_way.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            task.get_loop().call_exception_handler({"message": "emulated camera", "exception": error, "task": task})

    async def _finish(self, order: Order, exposed_s: float) -> None:
        """Develop a frame and send it when it would have been read out."""
        verb = self._verb
        try:
            developed = await self._darkroom.develop(order)
        finally:
            self._developing = False
        if developed.seen is not None:
            self._twin.tell_view(order.shot, order.sequence, developed.seen)
        self.controls.expose_by_itself(developed.mean)
        readout_s = self._twin.nominal.camera_readout_s * (SLOW_FACTOR if verb is Verb.SLOW else 1.0)
        if verb is Verb.DELAYED:
            readout_s += STALE_S
        if (rest_s := exposed_s + readout_s - self._clock()) > 0.0:
            await asyncio.sleep(rest_s)
        self._send(developed, {"stream", "left"})
        if self.right_late_s > 0.0:
            await asyncio.sleep(self.right_late_s)
        self._send(developed, {"right"})

    def _send(self, developed: Developed, views: set[str]) -> None:
        verb = self._verb
        if verb is Verb.OFF or (verb is Verb.INTERMITTENT and self._random.random() < FAILING_SHARE):
            return
        if verb is not Verb.STUCK:
            self._stuck.clear()
        for viewer in self._viewers:
            if viewer.view in views and (jpeg := developed.jpegs.get(viewer.view)) is not None:
                if verb is Verb.STUCK:
                    jpeg = self._stuck.setdefault(viewer.view, jpeg)
                viewer.offer(self._torn(jpeg) if verb is Verb.GARBAGE else jpeg)

    def _torn(self, jpeg: bytes) -> bytes:
        """As lost packets leave it: the end missing, or a piece out of the middle."""
        cut = len(jpeg) // 4 + int(self._random.integers(len(jpeg) // 2))
        return jpeg[:cut] if self._random.random() < 0.5 else jpeg[:cut] + jpeg[cut + len(jpeg) // 8 :]

    # --- what the port answers

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        response = web.StreamResponse(headers={"Content-Type": f"multipart/x-mixed-replace; boundary={_BOUNDARY}"})
        viewer = _Viewer(request.path.lstrip("/"), request)
        self._viewers.add(viewer)
        try:
            if self._verb is not Verb.OFF:
                await response.prepare(request)
            while (jpeg := await viewer.frames.get()) is not None:
                if not response.prepared:
                    await response.prepare(request)
                head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                await response.write(head.encode() + jpeg + b"\r\n")
        except ConnectionError:
            pass  # the viewer has gone, which is its good right
        finally:
            self._viewers.discard(viewer)
        return response

    async def _tell_controls(self, request: web.Request) -> web.Response:
        await self._hear()
        return web.json_response(self.controls.described())

    async def _set_controls(self, request: web.Request) -> web.Response:
        await self._hear()
        try:
            wanted = {str(name): float(value) for name, value in (await request.json()).items()}
            self.controls.take(wanted)
        except (ValueError, TypeError, AttributeError, KeyError) as error:
            raise web.HTTPBadRequest(text=f"expected a JSON object of known controls and numbers: {error}") from error
        return web.json_response(self.controls.described())

    async def _hear(self) -> None:
        """A camera that is off hears nothing and never answers."""
        if self._verb is Verb.OFF:
            await asyncio.Event().wait()


def _socket_on(port: int) -> socket.socket:
    door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    try:
        door.bind((HOST, port))
    except BaseException:
        door.close()
        raise
    return door
