"""``optimize-posture detect``: a table of measurements from pictures of a board."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.output import write_text


@click.command("detect")
@click.argument("images", nargs=-1, required=True, type=PATH, metavar="IMAGES...")
@click.option(
    "--board", required=True, metavar="TEXT", help="charuco:5x7:30mm:22mm, chessboard:8x6:25mm, grid:8x6:25mm"
)
@click.option("--joints", type=PATH, metavar="CSV", help="Posture of every picture; default: joints.csv beside them.")
@click.option("--camera", default="camera", show_default=True, metavar="NAME", help="Its name in the table.")
@click.option("--name", default="board", show_default=True, metavar="NAME", help="Of the board in the table.")
@click.option("--dictionary", default="5X5_1000", show_default=True, metavar="NAME", help="Of the marks of ChArUco.")
@click.option("--out", type=PATH, metavar="FILE", help="Write the table to a file.")
@click.option("--debug", is_flag=True, hidden=True)
def detect_command(
    images: tuple[Path, ...], board: str, joints: Path | None, camera: str, name: str, dictionary: str,
    out: Path | None, debug: bool,
) -> None:  # fmt: skip
    """A table of measurements from pictures of a board: pixels of its points, with the joints of every picture.

    \b
    --board charuco:5x7:30mm:22mm    squares in a row x in a column, side of a square, side of a mark
    --board chessboard:8x6:25mm      inner corners in a row x in a column, side of a square
    --board grid:8x6:25mm            circles in a row x in a column, their distance

    joints.csv has a column 'image' with the names of the pictures, and the columns of the joints with their units.
    OpenCV finds the points: pip install 'posture_opt[camera]'.
    """
    found = deferred.detected(images, board, joints, camera, name, dictionary)
    write_text(out, found.text)
    click.echo(_said(found.found), err=True)


def _said(counts: Mapping[str, int]) -> str:
    """How many points were found, and in which pictures none was."""
    none = [name for name, count in counts.items() if not count]
    text = f"{sum(counts.values())} points in {len(counts) - len(none)} of {len(counts)} pictures"
    return f"{text}; the board was not found in {', '.join(none)}" if none else text
