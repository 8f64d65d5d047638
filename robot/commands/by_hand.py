"""What the commands by hand have in common: their options, the confirmation, and the life of a session."""

from __future__ import annotations

import asyncio
import functools
import inspect
import math
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from robot.clock import RealClockLoop, run_real, run_virtual
from robot.commands.run import (
    ConfigOption,
    FaultOption,
    SeedOption,
    SpeedOption,
    TraceOption,
    load_with_seed,
    single_error,
)
from robot.commands.terminal import Answers
from robot.config import Config
from robot.errors import UsageError
from robot.package_files import config_file
from robot.runtime import EmulatorOptions, StopSignals, emulator_process
from robot.runtime.devices import fault_plan
from robot.runtime.manual import ByHand, ManualOptions, manual

Act = Callable[[ByHand], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class HandOptions:
    """The options that every command by hand takes."""

    config: Path
    seed: int | None
    truth: Path | None
    speed: float
    out: Path | None
    emulate: bool
    fault: list[str] | None
    trace: Path | None


def _shared(
    config: ConfigOption,
    seed: SeedOption = None,
    truth: Annotated[Path | None, typer.Option("--truth", help="Where the simulation writes what happened.")] = None,
    speed: SpeedOption = 1.0,
    out: Annotated[Path | None, typer.Option("--out", help="Run directory; default from the configuration.")] = None,
    emulate: Annotated[bool, typer.Option("--emulate", help="Start the emulated rover beside the command.")] = False,
    fault: FaultOption = None,
    trace: TraceOption = None,
) -> None:
    """Stands for its options."""


def by_hand(command: Callable[..., int]) -> Callable[..., int]:
    """A command with the shared options; it is given them as its first argument, a ``HandOptions``."""
    shared = inspect.signature(_shared, eval_str=True).parameters
    own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]

    @functools.wraps(command)
    def with_options(**given: Any) -> int:
        options = HandOptions(**{name: given.pop(name) for name in shared})
        return command(options, **given)

    parameters = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in (*own, *shared.values())]
    with_options.__signature__ = inspect.Signature(parameters, return_annotation=int)  # type: ignore[attr-defined]
    with_options.__annotations__ = {each.name: each.annotation for each in parameters} | {"return": int}
    return with_options


class HandCommand:
    """One command by hand, from its options to its end."""

    def __init__(self, options: HandOptions) -> None:
        self.config: Config = load_with_seed(options.config, options.seed)
        self.path = config_file(options.config)
        self.answers = Answers()
        self._options = options
        self._console = Console(stderr=True)
        self._simulated = self.config.simulated or options.emulate
        if options.emulate and not self.config.emulated:
            raise UsageError(f"{options.config}: has no emulated rover (twin.behind is not 'emulators')")
        if options.fault and not self._simulated:
            raise UsageError("--fault works on the simulated machine only; use mocks or --emulate")
        fault_plan(options.fault or ())  # refused before anything is opened
        if math.isnan(options.speed):
            raise UsageError("--speed nan: expected simulated seconds a second")

    @property
    def folder(self) -> Path:
        return self._options.out or self.config.robot.run_directory

    def confirm(self, word: str, what: str, *, always: bool, yes: bool = False) -> None:
        """A typed ``word`` before real hardware moves, and in simulation when ``always`` and not ``yes``.

        ``UsageError`` when it does not come, or when ``yes`` would stand in for a person at real hardware.
        """
        if self._simulated and (yes or not always):
            return
        if not self._simulated:
            if yes:
                raise UsageError("--yes is for simulation; real hardware is confirmed by a person at its terminal")
            if not sys.stdin.isatty():
                raise UsageError(f"real hardware must be confirmed at a terminal: {what}; start it by hand")
            sys.stdout.write(f"{self.config.robot.name} is REAL hardware.\n")
        sys.stdout.write(f"{what}\n")
        if self.answers.ask_at_once(f"Type '{word}' to go on: ") != word:
            raise UsageError(f"not confirmed ('{word}' was not typed); nothing was started")

    def live(self, act: Act) -> None:
        """A session with ``act`` in it: mocks in virtual time, everything else in real time."""
        options = self._options
        signals = StopSignals().install()  # for good: a signal that comes after letting go cuts nothing

        async def session(ports: dict[str, str]) -> None:
            choices = ManualOptions(
                self.path, self.folder, options.truth, ports, tuple(options.fault or ()), options.trace
            )
            async with manual(self.config, choices, signals, self.tell) as hands:
                await act(hands)

        async def beside_emulator() -> None:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, RealClockLoop)
            rover = EmulatorOptions(
                self.path, self.config.twin.seed, loop.zero_s, options.truth, tuple(options.fault or ())
            )
            async with emulator_process(rover) as ports:
                await session(ports)

        try:
            if self.config.simulated:
                run_virtual(session({}), pace=options.speed or None)
            else:
                run_real(beside_emulator() if options.emulate else session({}))
        except ExceptionGroup as group:
            raise single_error(group) from group

    def tell(self, text: str) -> None:
        self._console.print(Text(text, style="yellow"), soft_wrap=True)

    def say(self, text: str) -> None:
        """A line of the command's result."""
        sys.stdout.write(f"{text}\n")
