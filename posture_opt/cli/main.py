"""``optimize-posture``: the group of commands, its standard streams, exit codes and error messages."""

from __future__ import annotations

import contextlib
import errno
import gc
import io
import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from importlib import import_module
from types import FrameType
from typing import Any, NoReturn, TextIO, cast

import click
from click.shell_completion import CompletionItem

from posture_opt import __version__
from posture_opt.cli.completion import VARIABLE, complete
from posture_opt.cli.options import Common, common_options, problem_options, task_options
from posture_opt.errors import InputError, Issue, PostureOptError, nearest
from posture_opt.interrupts import interruptible


class Ended(KeyboardInterrupt):
    """Another program, or the terminal that closes, asks this one to end by a signal."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number: int = number


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the body as ^C does: what it began is cleaned up."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise Ended(number)

    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    former = {number: signal.getsignal(number) for number in numbers}
    heard = [number for number in numbers if former[number] == signal.SIG_DFL]
    for number in heard:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, former[number])


def open_standard_streams() -> None:
    """Open what the caller closed, so that no file of ours gets its number; a terminal without σ shows ``?``."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)
            os.set_inheritable(opened, True)
    sys.stdout, sys.stderr = _writable(sys.stdout, 1), _writable(sys.stderr, 2)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _writable(stream: TextIO | None, number: int) -> TextIO:
    if stream is None:
        return os.fdopen(number, "w", encoding="utf-8", closefd=False)
    if isinstance(getattr(stream, "buffer", None), io.RawIOBase):  # PYTHONUNBUFFERED: half a write would pass for all
        return os.fdopen(number, "w", encoding=stream.encoding, closefd=False)
    return stream


def discard(stream: TextIO | None) -> None:
    """Redirect a stream that takes nothing to the null device: its buffer would fail again at exit."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        number = stream.fileno()  # type: ignore[union-attr]
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


COMMANDS = {
    # name -> one line for --help
    "batch": "Select postures for many problem files, in one report.",
    "calibrate": "Estimate the parameters of the arm from measurements.",
    "compensate": "Compute joint values that bring this arm, with its errors, to targets.",
    "completion": "Print a script that completes words in bash, zsh or fish.",
    "compare": "Compare two arms, or two models of one arm, on one task.",
    "detect": "Detect a board in pictures and write a table of measurements.",
    "diagnose": "Identify the causes of the remaining errors from measurements.",
    "explore": "Drag the target on a live page; the best posture follows.",
    "export": "Export the arm, its covariance as code, or a robot program.",
    "list": "List tasks, effects, presets, solvers, terms, exports and built-in problems.",
    "map": "Map the best posture and its spread over a grid of targets.",
    "new": "Print a commented problem file to start from.",
    "plan-measurements": "Select the most informative postures to measure next.",
    "recheck": "Find what changed on a calibrated arm, from a few new measurements.",
    "schema": "Print the JSON Schema of the problem file.",
    "simulate": "Simulate the tool point at one posture and compare it with the closed form.",
    "uncertainty": "Compute covariance, ellipse, coverage regions and error budget at one posture.",
}
_FILES = {
    # file -> the commands in it; `plan-measurements` is its function `plan_measurements_command`
    "completion": ("completion",),
    "many": ("batch", "compare", "map"),
    "measured": ("calibrate", "diagnose", "recheck"),
    "measuring": ("detect", "plan-measurements"),
    "posture": ("explore", "simulate", "uncertainty"),
    "problem_file": ("list", "new", "schema"),
    "robot_programs": ("compensate", "export"),
}


# What imports leave behind stays: looking for circles in it every 700 objects is a twelfth of a cold start.
gc.set_threshold(50_000, 20, 20)
# pydantic would look for plugins in every installed package, 50 ms of a cold start; there are none for our files.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
# Matrices are small here: on a busy machine, threads that wait for each other cost tenfold.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Figures become files, whatever shows them elsewhere: matplotlib ends where it does not know what MPLBACKEND names.
os.environ["MPLBACKEND"] = "agg"


class PostureCommands(click.Group):
    """The commands by name, imported late; every way out of the program goes through ``main``."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names of all commands, sorted."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of a name, its file imported now; None where there is no such command."""
        if cmd_name not in COMMANDS:
            return None
        file = next(file for file, names in _FILES.items() if cmd_name in names)
        found = getattr(import_module(f"posture_opt.cli.{file}"), f"{cmd_name.replace('-', '_')}_command")
        return cast(click.Command, found)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The command that the first word names."""
        if args and args[0] not in COMMANDS:
            near = nearest(args[0], COMMANDS)
            hint = f"Did you mean '{near}'?" if near else f"Commands: {', '.join(sorted(COMMANDS))}."
            if ctx.resilient_parsing:  # a word is completed
                return None, None, []
            raise click.UsageError(f"No such command '{args[0]}'. {hint}", ctx)
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """The commands that begin so, without their files, or the options."""
        commands = [CompletionItem(name, help=text) for name, text in COMMANDS.items() if name.startswith(incomplete)]
        return [*commands, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The section "Commands" of the help, from the lines above: no command is imported for it."""
        with formatter.section("Commands"):
            formatter.write_dl(sorted(COMMANDS.items()))

    def main(  # type: ignore[override] # it never returns, whatever the mode
        self, args: Sequence[str] | None = None, prog_name: str | None = None, **extra: Any
    ) -> NoReturn:
        """Run the command line and end the program with one of the codes of the help text."""
        words = list(sys.argv[1:] if args is None else args)
        open_standard_streams()
        try:
            with ended_by_signals(), interruptible():
                code = self._run(list(words), prog_name or "optimize-posture", extra)
                sys.stdout.flush()
        except (Exception, KeyboardInterrupt) as error:
            sys.exit(_report_error(error, debug="--debug" in words, as_json="--json" in words))
        sys.exit(code)

    def _run(self, words: list[str], prog_name: str, extra: dict[str, Any]) -> int:
        """As click's ``main``, without its own ideas of interrupts and closed pipes."""
        extra.pop("standalone_mode", None)
        if asked := os.environ.get(VARIABLE):
            complete(self, asked)
            return 0
        wrong = [word for word in words if any("\ud800" <= c <= "\udfff" for c in word)]
        if wrong:  # what Python makes of bytes that are no text can be neither printed nor written
            raise InputError([Issue("the argument is not UTF-8", (word,), word, "write it as UTF-8") for word in wrong])
        try:
            with self.make_context(prog_name, words, **extra) as ctx:
                self.invoke(ctx)
        except click.exceptions.Exit as leaving:
            return leaving.exit_code
        except click.NoSuchOption as error:  # two dashes alone are no likeness
            near = nearest(error.option_name.lstrip("-"), [name.lstrip("-") for name in error.possibilities or ()])
            raise click.NoSuchOption(
                error.option_name, possibilities=[f"--{near}"] * bool(near), ctx=error.ctx
            ) from None
        return 0


def _report_error(error: BaseException, debug: bool, as_json: bool) -> int:
    """The exit code of an error, after its text on standard error, and its document where JSON was asked for."""
    try:
        if as_json and not getattr(error, "shown", False) and isinstance(error, PostureOptError | click.ClickException):
            if isinstance(error, click.ClickException):
                reported: PostureOptError = InputError(Issue(error.format_message(), id="input.usage"))
            else:
                reported = error
            click.echo(json.dumps(reported.to_json(), indent=2, ensure_ascii=False))
        return _exit_code(error, debug)
    except OSError:
        discard(sys.stderr)
        return _exit_code(error, debug)


def _exit_code(error: BaseException, debug: bool) -> int:
    if isinstance(error, KeyboardInterrupt):
        click.echo("interrupted", err=True)
        return 128 + (error.number if isinstance(error, Ended) else signal.SIGINT)  # as shells have it
    if isinstance(error, click.ClickException):
        error.show()
        return 2
    if debug:
        traceback.print_exception(error)
    if isinstance(error, OSError):
        discard(sys.stdout)
        if isinstance(error, BrokenPipeError):
            return 0  # a reader that closed the pipe has seen enough
        reason = "it is closed" if error.errno == errno.EBADF else error.strerror or str(error)
        click.echo(f"error: cannot write to {error.filename or 'standard output'}: {reason}", err=True)
        return 2
    if isinstance(error, PostureOptError):
        lines = str(error).splitlines() or [type(error).__name__]
        several = f"{len(error.issues)} errors:" if isinstance(error, InputError) else "error:"
        click.echo(f"error: {lines[0]}" if len(lines) == 1 else "\n  ".join([several, *lines]), err=True)
        return error.exit_code
    if isinstance(error, MemoryError) or _unmapped(error):
        click.echo("error: memory does not suffice – take fewer --workers, rows or targets", err=True)
        return 2
    hint = "" if debug else " (a defect of this program; --debug shows where)"
    click.echo(f"error: {type(error).__name__}: {error}".splitlines()[0] + hint, err=True)
    return 1


def _unmapped(error: BaseException) -> bool:
    """Whether there was no memory for a library that is loaded when it is needed."""
    while isinstance(error, ImportError) and "failed to map" not in str(error):
        error = error.__cause__ or error.__context__ or ValueError()
    return isinstance(error, ImportError)


@click.command(
    "optimize-posture",
    cls=PostureCommands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog="Exit codes: 0 done, 1 a defect of this program, 2 bad input, 3 no solution, 4 too few data.",
)
@task_options
@problem_options
@click.option("--explain", is_flag=True, help="Show the optimisation problem with its values at the solution.")
@common_options
@click.version_option(__version__, prog_name="optimize-posture")
@click.pass_context
def main(ctx: click.Context, /, common: Common, explain: bool, **given: str | None) -> None:
    """Select the robot posture with the smallest position uncertainty for a task.

    \b
    optimize-posture --task insert                         the built-in planar arm
    optimize-posture --problem FILE.yaml                   your own robot, uncertainty and task
    optimize-posture --task insert --robot ur10e --position "0.6 m, 0.2 m, 0.1 m"
    """
    if ctx.invoked_subcommand is not None:
        stated = [name for name, value in given.items() if value] + ["explain"] * explain
        names = {f.name: f.default for f in fields(Common)}  # --debug counts anywhere
        stated += [{"plots": "no-plots"}.get(n, n) for n, usual in names.items() if getattr(common, n) != usual]
        if stated:
            raise click.UsageError(f"Write --{stated[0].replace('_', '-')} after '{ctx.invoked_subcommand}'.", ctx)
        return
    if not any(given.values()):
        if common != Common():
            raise click.UsageError("Nothing to solve: name a --task or a --problem.", ctx)
        click.echo(ctx.get_help())
        return
    import_module("posture_opt.cli.posture").solve(common, explain, **given)
