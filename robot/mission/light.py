"""A pair in the best light to be had: metered on the plants, exposed anew, the lamp lit at dusk."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

from drivers.camera.frame_checks import PictureFault
from drivers.camera.frame_watch import BadPicture
from drivers.camera.values import StereoFrame
from drivers.errors import DeviceRefused
from robot.actuation import Refused
from robot.clock import work
from robot.ledger import StopLight
from robot.mission.context import MissionContext
from robot.mission.events import LightSeen
from robot.vision import light
from robot.vision.light import LampMemory, LightState, Reading, Setting

MOST_TRIES = 6        # from the shortest exposure to the greatest gain takes five
HALVINGS = 4          # of a step that the camera cannot make
METER_S = 0.02        # modelled
LAMP_SETTLE_S = 0.2
_LEAST_ADDED = 1.02   # a lamp that gives less is told


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A pair, what the meter reads in it, and what it showed against the camera itself (a black or white picture)."""

    frame: StereoFrame
    reading: Reading
    bad: BadPicture | None = None

    @property
    def setting(self) -> Setting:
        return Setting(self.frame.exposure_s, self.frame.gain)


async def look(context: MissionContext) -> tuple[StereoFrame, StopLight]:
    """A new pair, and its light. Where the camera refuses another exposure the pair is what it is.

    A picture that stays black or white at the bounds is the camera's fault, and raised as such.
    """
    seen = await _expose(context, await _metered(context))
    seen, lamp_remark = await _light_lamp(context, seen)
    if seen.bad is not None:
        raise seen.bad
    goals = context.settings.light.goals
    reading, setting = seen.reading, seen.setting
    state = light.judge(reading, goals)
    remarks = [lamp_remark, context.progress.exposure_refused if state is not LightState.GOOD else ""]
    remarks += [
        text
        for holds, text in (
            (not reading.plants_seen, "no plants seen"),
            (reading.backlight, "backlight"),
            (reading.glare, "glare"),
        )
        if holds
    ]
    found = StopLight(
        state=state,
        plant_level=reading.level,
        burnt_share=reading.burnt_share,
        illumination_1_s=reading.illumination_1_s,
        exposure_s=setting.exposure_s,
        gain=setting.gain,
        lamp=context.actuation.lamp_lit,
        remark="; ".join(filter(None, remarks)),
    )
    context.publish(LightSeen(context.progress.stop, found, seen.frame.stamp_s))
    return seen.frame, found


def mistrust(found: StopLight) -> str:
    """Why fruit is not looked for in this light; "" when it is."""
    if light.trusted(found.state):
        return ""
    how = (
        f"plants at {100.0 * found.plant_level:.1f} % of full scale"
        if found.state is LightState.DARK
        else f"{100.0 * found.burnt_share:.0f} % of the plants burnt out"
    )
    lamp = "lit" if found.lamp else "off"
    set_to = f"{1e3 * found.exposure_s:.1f} ms, gain {found.gain:.1f}, lamp {lamp}"
    return f"too {found.state} to trust: {how} with {set_to}" + (f" ({found.remark})" if found.remark else "")


async def _metered(context: MissionContext) -> Look:
    bad: BadPicture | None = None
    try:
        frame = await context.camera.capture()
    except BadPicture as error:
        if error.fault not in (PictureFault.BLACK, PictureFault.WHITE):
            raise
        frame, bad = error.frame, error
    reading = await work(lambda: light.meter(frame.left, frame.right, frame.exposure_s, frame.gain), METER_S)
    return Look(frame, reading, bad)


async def _expose(context: MissionContext, seen: Look) -> Look:
    settings = context.settings.light
    for _ in range(MOST_TRIES):
        wanted = light.next_setting(seen.reading, seen.setting, settings.bounds, settings.goals)
        if wanted == seen.setting or not settings.adjusts or not await _set(context, seen.setting, wanted):
            break
        seen = await _metered(context)
    return seen


async def _set(context: MissionContext, present: Setting, wanted: Setting) -> bool:
    """Whether the camera took it, or went some of the way where its own bounds are narrower than those configured.

    One that refuses is not asked again in this mission.
    """
    progress, bounds = context.progress, context.settings.light.bounds
    if progress.exposure_refused:
        return False
    for _ in range(HALVINGS):
        if wanted == present:
            return False
        try:
            await context.camera.set_exposure(wanted.exposure_s, wanted.gain)
        except DeviceRefused as refused:
            progress.exposure_refused = f"the exposure is fixed: expected {refused.expected}"
            await context.record("light", str(refused))
            return False
        except ValueError:
            wanted = light.split(math.sqrt(present.product_s * wanted.product_s), bounds)
            continue
        return True
    return False


async def _light_lamp(context: MissionContext, seen: Look) -> tuple[Look, str]:
    """The lamp as the policy wants it, and the pair taken anew when it was switched; with a remark for a person."""
    settings, progress, actuation = context.settings.light, context.progress, context.actuation
    memory = LampMemory(actuation.lamp_lit, progress.lamp_added_1_s)
    before_1_s = seen.reading.illumination_1_s
    wanted = light.lamp_wanted(settings.lamp, memory, before_1_s, settings.lamp_beyond_s, settings.goals)
    if wanted == memory.lit:
        return seen, ""
    try:
        await actuation.switch_lamp(wanted)
    except (DeviceRefused, Refused) as refused:
        return seen, f"the lamp was not switched: {refused}"
    await asyncio.sleep(LAMP_SETTLE_S)
    again = await _expose(context, await _metered(context))
    after_1_s = again.reading.illumination_1_s
    progress.lamp_added_1_s = light.after_switch(wanted, before_1_s, after_1_s).added_1_s
    await context.record("light", f"lamp {'lit' if wanted else 'put out'}: {before_1_s:.2f} to {after_1_s:.2f} 1/s")
    dead = wanted and after_1_s < _LEAST_ADDED * before_1_s
    return again, "the lamp was lit and added no light" if dead else ""
