"""Options that several commands share, so that they have one name and one explanation everywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any

import click

from posture_opt.cli.completion import PATH, PROBLEM, ROBOT, TASK

Command = Callable[..., Any]
POSTURE_HELP = '"90 deg, -180 deg" in order, or "joint1=90 deg, joint2=-180 deg" by name.'
FRAME_HELP = '"0, 0, 150 mm" or, with roll, pitch, yaw, "0, 0, 150 mm, 0, 0, 90 deg".'


@dataclass(frozen=True)
class Common:
    """What every computing command can be given; ``main`` itself looks for ``--debug``."""

    out: Path | None = None
    json: bool = False
    seed: int | None = None
    workers: int = 1
    quiet: bool = False
    plots: bool = True
    full: bool = False


def common_options(command: Command) -> Command:
    """Adds the options of ``Common`` to a command, which gets them as its argument ``common``."""

    @wraps(command)
    def with_common(*args: Any, no_plots: bool, **given: Any) -> Any:
        given["plots"] = not no_plots
        common = Common(**{field.name: given.pop(field.name) for field in fields(Common)})
        return command(*args, common=common, **given)

    return add_options(
        with_common,
        click.option("--out", type=PATH, metavar="DIR", help="Write JSON, figures and a report here."),
        click.option("--json", is_flag=True, help="Print the JSON document and nothing else."),
        click.option("--seed", type=click.IntRange(min=0), help="Random seed; the same seed gives the same result."),
        click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes to use."),
        click.option("--full", is_flag=True, help="Print the whole report."),
        click.option("--quiet", is_flag=True, help="Print no report and no progress."),
        click.option("--no-plots", is_flag=True, help="Draw no figures into --out."),
        click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."),
    )


def problem_options(command: Command) -> Command:
    """Adds the options that name a robot and its uncertainty; the command gets them by their names, as text."""
    return add_options(
        command,
        click.option(
            "--problem", type=PROBLEM, metavar="FILE", help="Problem file (YAML), or the name of a built-in problem."
        ),
        click.option(
            "--robot",
            type=ROBOT,
            metavar="PRESET|FILE",
            help="A preset, a URDF file, or the robot and uncertainty of a problem file.",
        ),
        click.option("--base-link", metavar="LINK", help="First link of the chain in the URDF file."),
        click.option("--tip-link", metavar="LINK", help="Last link of the chain in the URDF file."),
        click.option("--tool", metavar="TEXT", help=f"Tool point in the flange: {FRAME_HELP}"),
        click.option("--base", metavar="TEXT", help="Base of the robot in the world, written as --tool."),
        click.option("--payload", metavar="TEXT", help='Mass at the tool point: "1.2 kg".'),
        click.option(
            "--sigma",
            metavar="TEXT",
            help='Standard deviation of every joint: "0.02 deg"; "0.02 deg, 0.01 mm" with prismatic joints.',
        ),
    )


def task_options(command: Command) -> Command:
    """Adds the options that name a task and its target; the command gets them by their names, as text."""
    return add_options(
        command,
        click.option("--task", type=TASK, metavar="KIND", help="insert, drill, probe, …: see the command 'list'."),
        click.option("--position", metavar="TEXT", help='Target in the world: "0.6 m, 0.2 m, 0.1 m".'),
        click.option("--region", metavar="TEXT", help='Target in a box: "0.5 m, 0 m, 0.2 m to 0.7 m, 0 m, 0.2 m".'),
        click.option("--direction", metavar="TEXT", help='Task direction in the world frame: "0, 0, -1".'),
        click.option(
            "--tool-axis", metavar="TEXT", help='Tool axis held along the direction, tool frame.  [default: "0, 0, 1"]'
        ),
        click.option("--tilt", metavar="TEXT", help='Largest angle between both: "5 deg".'),
        click.option("--clearance", metavar="TEXT", help='Radial play of the hole: "0.2 mm".'),
        click.option("--ordinary", metavar="TEXT", help='Share that an ordinary posture may cost.  [default: "3 %"]'),
        click.option("--limit-margin", metavar="TEXT", help='Smallest distance of joints from their limits: "5 deg".'),
        click.option("--link-height", metavar="TEXT", help='Smallest height of all links in the world: "50 mm".'),
    )


def posture_option(command: Command) -> Command:
    """Adds the option that names a posture."""
    return add_options(
        command, click.option("--posture", metavar="TEXT", required=True, help=f"Joint values: {POSTURE_HELP}")
    )


def add_options(command: Command, *options: Callable[[Command], Command]) -> Command:
    """A command with options, which its help lists in this order."""
    for option in reversed(options):  # click shows the option that is added last at first
        command = option(command)
    return command


def debug_option(command: Command) -> Command:
    """Let a command without the common options take ``--debug``, for which ``main`` looks."""
    return add_options(command, click.option("--debug", is_flag=True, hidden=True, expose_value=False))
