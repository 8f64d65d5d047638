"""``sprayer jog``: joints, nozzle and base, moved by hand in small steps."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Annotated

import typer

from robot.commands.by_hand import HandCommand, HandOptions, by_hand
from robot.commands.terminal import at_terminal, require_terminal
from robot.errors import UsageError
from robot.runtime.manual import ByHand
from robot.runtime.manual.arm import (
    check_joint_step,
    check_nozzle_step,
    jog_joint,
    jog_nozzle,
    joints_of,
    nozzle_in_base,
)
from robot.runtime.manual.base import check_step, hold_to_run, step
from robot.runtime.settings import load_arm

app = typer.Typer(help="Move the machine by hand, in small steps.", no_args_is_help=True)
_NUMBERS = {"ignore_unknown_options": True}  # so that -0.1 is a number and not an option
_ONE_STEP = "give --forward-m X for one step"

ArmSpeedOption = Annotated[
    float, typer.Option("--speed-limit", min=0.01, max=2.0, metavar="RAD_S", help="No joint turns faster.")
]


@app.command("joint", context_settings=_NUMBERS)
@by_hand
def jog_a_joint(
    options: HandOptions,
    name: Annotated[str, typer.Argument(metavar="NAME", help="The joint, as the arm's URDF names it.")],
    by_rad: Annotated[float, typer.Argument(metavar="BY_RAD", help="Radians; minus turns back.")],
    speed_limit: ArmSpeedOption = 0.3,
) -> int:
    """Turn one joint; the others stand still."""
    command = HandCommand(options)
    model, _ = load_arm(command.config, command.path)
    check_joint_step(model, name, by_rad)
    return move_arm(command, f"{name} by {by_rad:g} rad", lambda hands: jog_joint(hands, name, by_rad, speed_limit))


@app.command("nozzle", context_settings=_NUMBERS)
@by_hand
def jog_the_nozzle(
    options: HandOptions,
    dx: Annotated[float, typer.Argument(metavar="DX", help="Metres forward.")],
    dy: Annotated[float, typer.Argument(metavar="DY", help="Metres to the left.")],
    dz: Annotated[float, typer.Argument(metavar="DZ", help="Metres up.")],
    speed_limit: ArmSpeedOption = 0.3,
) -> int:
    """Shift the nozzle in the rover's frame; it goes on pointing the same way."""
    command = HandCommand(options)
    by_m = (dx, dy, dz)
    check_nozzle_step(by_m)
    what = f"the nozzle by {dx:g} {dy:g} {dz:g} m"
    return move_arm(command, what, lambda hands: jog_nozzle(hands, by_m, speed_limit))


@app.command("base", context_settings=_NUMBERS)
@by_hand
def jog_the_base(
    options: HandOptions,
    forward_m: Annotated[
        float | None, typer.Option("--forward-m", metavar="M", help="One step of so many metres; minus is back.")
    ] = None,
    speed_limit: Annotated[
        float, typer.Option("--speed-limit", min=0.01, max=1.0, metavar="M_S", help="The wheels do not go faster.")
    ] = 0.1,
) -> int:
    """Drive as long as w, s, a, d or an arrow is held (any other key stops, q ends); or one step with --forward-m."""
    command = HandCommand(options)
    fastest_m_s = min(command.config.safety.max_base_speed_m_s, command.config.wheels.max_speed_m_s)
    if speed_limit > fastest_m_s:
        raise UsageError(f"--speed-limit {speed_limit:g}: the configuration allows {fastest_m_s:g} m/s at the most")
    gone_m: list[float] = []
    if forward_m is None:
        require_terminal(_ONE_STEP)
        command.confirm("move", "The base is about to drive by keys.", always=False)
        with at_terminal(_ONE_STEP) as keys:
            command.tell("w/s or arrows up/down: ahead, back; a/d or left/right: turn; any other key stops; q ends")

            async def by_keys(hands: ByHand) -> None:
                gone_m.append(await hold_to_run(hands, keys, speed_limit))

            command.live(by_keys)
    else:
        check_step(forward_m)
        command.confirm("move", f"The base is about to drive {forward_m:g} m.", always=False)

        async def by_step(hands: ByHand) -> None:
            gone_m.append(await step(hands, forward_m, speed_limit))

        command.live(by_step)
    command.say(f"driven: {gone_m[0]:.3f} m by the wheels' count")
    return 0


def move_arm(command: HandCommand, what: str, motion: Callable[[ByHand], Awaitable[None]]) -> int:
    """One motion of the arm, with its joint angles before and after."""
    command.confirm("move", f"The arm is about to move: {what}.", always=False)

    async def act(hands: ByHand) -> None:
        command.say(f"before: {posture(hands)}")
        await motion(hands)
        command.say(f"after:  {posture(hands)}")

    command.live(act)
    return 0


def posture(hands: ByHand) -> str:
    """Joint angles in radians and the nozzle's place in the rover's frame, in one line."""
    names = hands.settings.arm_model.joint_names
    joints = ", ".join(f"{name} {angle:+.3f}" for name, angle in zip(names, joints_of(hands), strict=True))
    x_m, y_m, z_m = nozzle_in_base(hands)[0]
    return f"{joints} rad; nozzle at {x_m:+.3f} {y_m:+.3f} {z_m:+.3f} m"
