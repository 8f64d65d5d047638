"""Everything wet: the pump on its leases, and shots that are written down before they are fired."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable

from drivers.errors import DeviceError
from drivers.inputs.interface import Inputs as InputDevices
from drivers.relay.interface import RelayBoard
from drivers.relay.values import Channel
from robot import safety
from robot.actuation.booking import FlowAccount, missed, outcome_of
from robot.actuation.bookkeeping import Bookkeeper
from robot.actuation.flow_watch import FlowWatch
from robot.actuation.gate import Gate, now_s
from robot.actuation.readings import Readings
from robot.actuation.stopping import stop_part
from robot.actuation.values import HandSettings, PartStopped, PulseOrder, Refused
from robot.ledger import Ledger
from robot.ledger.values import Intent, Leak, Outcome, Result

METER_SETTLE_S = 0.15  # after the valve is shut, until the flow meter has counted its last pulse

Stop = Callable[[str], Awaitable[tuple[PartStopped, ...]]]
Report = Callable[[str, str], Awaitable[None]]


class Liquid:
    """Opens the valve and runs the pump, always by the board's own timers.

    ``stop`` stops the whole machine; ``report`` takes a fault of the catalogue and does what it asks for.
    """

    def __init__(
        self, relay: RelayBoard, inputs: InputDevices, ledger: Ledger, gate: Gate, readings: Readings,
        settings: HandSettings, stop: Stop, report: Report,
    ) -> None:  # fmt: skip
        self._relay, self._inputs = relay, inputs
        self._gate, self._readings, self._settings = gate, readings, settings
        self._stop, self._report = stop, report
        self._account = FlowAccount(settings)
        self._books = Bookkeeper(ledger)
        self._flow = FlowWatch(ledger, settings.meter_ml_per_pulse)
        self._task_id: int | None = None
        self._pump_wanted = False
        self._pump_until_s = -math.inf
        self._cut = asyncio.Event()
        self._cut_reason = ""
        self.shot_under_way = False

    async def nozzle_checked(self, operator: str) -> None:
        """An operator has seen to the nozzle: its history begins anew."""
        await self._flow.checked(operator)

    def begin_task(self, task_id: int) -> None:
        self._task_id = task_id

    async def begin_metering(self) -> None:
        """Start the flow account at the meter's present count, and the flow history with that of earlier runs.

        What passed the meter since the last run, and is not booked, gets its row.
        """
        await self._flow.begin()
        self._readings.sensors = reading = await self._inputs.read()
        total_ml, stamp_s = reading.flow_total_ml, reading.stamp_s
        await self._books.begin_metering(
            self._task_id, total_ml, lambda mark: missed(mark, total_ml, stamp_s, self._settings)
        )
        self._account.begin(total_ml, stamp_s)

    async def finish(self) -> str:
        """Before the program ends: what still waits for the ledger; why it was lost, "" when nothing was."""
        return await self._books.finish()

    def board_pulse_s(self, open_s: float) -> float:
        """The board's own timer for an opening: the next multiple of its quantum."""
        quantum_s = self._relay.capability.pulse_quantum_s
        return quantum_s * math.ceil(open_s / quantum_s - 1e-9)

    def cut(self) -> None:
        """Shut the valve of a shot under way at once, and renew the pump no more: its lease is cancelled with it."""
        self._cut.set()
        self._pump_wanted = False
        self._pump_until_s = -math.inf

    def interrupt(self, reason: str) -> None:
        """Shut the valve of a shot under way at once, for a ``reason`` that does not stop the machine."""
        if self.shot_under_way and not self._cut.is_set():
            self._cut_reason = reason
            self._cut.set()

    async def look_for_leak(self) -> None:
        """Book what the newest reading shows past the shut valve, and stop the machine, its pump and its power for it.

        The litres go on being booked as long as they run, armed or not.
        """
        sensors = self._readings.sensors
        if not self.shot_under_way and sensors is not None:
            leak = self._account.leaked(sensors.flow_total_ml, sensors.stamp_s)
            if leak is not None:
                await self._take_leak(leak)
        self._books.retry()
        await self._look_at_disk()

    async def _look_at_disk(self) -> None:
        for fault_id, text in self._books.faults.items():
            if not self._gate.stands(fault_id):
                await self._report(fault_id, text)
        if "F39" not in self._books.faults and self._gate.stands("F39"):
            self._gate.clear("F39")

    async def _take_leak(self, leak: Leak) -> None:
        self._gate.book_leak(leak.booked_ml)
        self._books.leak(self._task_id, leak, self._account.booked_to_ml)
        if self._gate.stands("F10"):
            return
        text = (
            f"the valve leaks: {leak.booked_ml:.1f} ml passed the flow meter while it was shut; "
            "close the supply and change the valve"
        )
        self.cut()
        await asyncio.gather(
            stop_part("pump", lambda: self._relay.cancel(Channel.PUMP)),
            stop_part("contactor", lambda: self._relay.switch(Channel.CONTACTOR, False)),
            self._report("F10", text),
        )

    async def start_pump(self) -> None:
        """Ask for pressure. The pump runs on leases: it stops by itself when nobody renews them."""
        self._gate.demand_armed()
        self._pump_wanted = True
        await self.renew_pump()

    async def stop_pump(self) -> None:
        self._pump_wanted = False
        self._pump_until_s = -math.inf
        await self._relay.cancel(Channel.PUMP)

    async def renew_pump(self, at_least_s: float | None = None) -> None:
        """Renew the lease when the pump is wanted and less than ``at_least_s`` (half a lease) is left of it."""
        least_s = self._settings.pump_lease_s / 2 if at_least_s is None else at_least_s
        if self._pump_wanted and self._gate.armed and self._pump_until_s - now_s() < least_s:
            receipt = await self._relay.pulse(Channel.PUMP, self._settings.pump_lease_s)
            self._pump_until_s = receipt.sent_s + receipt.duration_s

    async def spray(self, order: PulseOrder) -> Result:
        """Open the valve once and account for it.

        Safety is asked, the intent is durable before the valve opens, the close is not cancellable, the outcome is
        booked from the flow meter. ``Refused`` or a ledger error before anything opened. When the caller is cancelled
        the valve is shut at once, the shortened shot is booked, and then the cancellation goes on.
        """
        if self._task_id is None:
            raise Refused("no task is open in the ledger; begin one before spraying")
        await self.renew_pump(order.pulse_s + 1.0)
        request = safety.SprayRequest(
            order.target_id, order.dose_ml, order.full_ml, order.open_s, order.pulse_s, order.cell
        )
        self._gate.demand_spray(request)
        self._cut.clear()
        self._cut_reason = ""
        self.shot_under_way = True
        section = asyncio.create_task(self._account_for(order, self._task_id), name=f"shot at target {order.target_id}")
        cancelled = False
        while not section.done():
            try:
                await asyncio.shield(section)
            except asyncio.CancelledError:
                cancelled = True
                self._cut.set()
            except Exception:  # noqa: BLE001 - the section's own error: raised by section.result() below
                break
        if cancelled:
            if (error := section.exception()) is not None:
                raise asyncio.CancelledError(str(error)) from error
            raise asyncio.CancelledError
        return section.result()

    async def _account_for(self, order: PulseOrder, task_id: int) -> Result:
        """From intent to outcome; never cancelled, ends by its own deadlines."""
        booked_ml = order.full_ml
        try:
            intent = Intent(
                target_id=order.target_id, stop=order.stop, pulse=order.number, due_ml=order.due_ml,
                dose_ml=order.dose_ml, open_s=order.open_s, pulse_s=order.pulse_s, full_ml=order.full_ml,
                stamp_s=now_s(), factor=order.factor, reason=order.reason, model_ml=order.model_ml,
            )
            try:
                intent_id = await self._books.intent(task_id, intent)
            except Exception:
                booked_ml = 0.0  # nothing was opened
                raise
            result = await self._open_and_close(order)
            booked_ml = result.booked_ml
            await self._books.result(intent_id, result, self._account.booked_to_ml)
            if result.outcome is Outcome.UNCERTAIN:
                await self._stop(f"the shot at target {order.target_id} is uncertain: {result.reason}")
            await self._look_at_flow(order, result)
            return result
        except Exception as error:
            await self._stop(f"the shot at target {order.target_id} could not be accounted for: {error}")
            raise
        finally:
            self._gate.settle(order.target_id, booked_ml)
            self.shot_under_way = False

    async def _open_and_close(self, order: PulseOrder) -> Result:
        last_look = self._gate.last_look()
        if self._cut.is_set() or not last_look.allowed:
            reason = "; ".join(last_look.reasons) or self._cut_reason or "stopped before the valve opened"
            return Result(Outcome.NOT_OPENED, 0.0, 0.0, None, reason, now_s())
        problem = ""
        opened_s = now_s()
        try:
            receipt = await self._relay.pulse(Channel.VALVE, order.open_s)
            opened_s = receipt.sent_s
            shut_at_s = opened_s + min(order.open_s, receipt.duration_s)
            try:
                async with asyncio.timeout_at(shut_at_s):
                    await self._cut.wait()
            except TimeoutError:
                pass
        except DeviceError as error:
            problem = f"open unconfirmed: {error}"
        shut_s = now_s()
        closing = await stop_part("valve", lambda: self._relay.cancel(Channel.VALVE))
        if not closing.error:
            closing = await stop_part("valve", self._read_back_shut)
        if closing.error:
            problem = f"{problem} close unconfirmed: {closing.error}".strip()
            await stop_part("contactor", lambda: self._relay.switch(Channel.CONTACTOR, False))
            await self._stop(f"the valve's closing is unconfirmed ({closing.error})")
        counted = await self._count()
        why_short = self._cut_reason or "a stop"
        result = outcome_of(order, shut_s - opened_s, problem, why_short, counted, self._settings, now_s())
        self._account.credit(result.booked_ml - (counted[1] or 0.0), opened_s + order.pulse_s + METER_SETTLE_S)
        return result

    async def _look_at_flow(self, order: PulseOrder, result: Result) -> None:
        problem = self._flow.take(order.model_ml, result, self._readings)
        if self._flow.dry:  # against air the pump does not run on
            await stop_part("pump", self.stop_pump)
        if problem:
            await self._report("F66", problem)

    async def _read_back_shut(self) -> None:
        self._readings.relay = await self._relay.read()
        if self._readings.relay.coils.get(Channel.VALVE, True):
            raise DeviceError("relay", "the valve's coil off", "on", "check the board for a welded contact")

    async def _count(self) -> tuple[float | None, float | None]:
        """Wait until the meter has counted the shot, and take the count; (None, None) when it does not answer."""
        await asyncio.sleep(self._settings.valve_close_s + METER_SETTLE_S)
        try:
            self._readings.sensors = await self._inputs.read()
        except DeviceError:
            return self._account.take(None, math.nan)  # the poll of the sensors reports the fault itself
        return self._account.take(self._readings.sensors.flow_total_ml, self._readings.sensors.stamp_s)
