"""The files of a report: JSON, text, one page with the figures inside, figures as PNG and SVG; all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posture_opt.output import json_text, staged_folder
from posture_opt.report.blocks import Summary
from posture_opt.report.page import Page
from posture_opt.report.style import image
from posture_opt.report.text import render

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAPTIONS = {
    "arm": "The arm in its posture, with the region that holds 95 % of the tool points (enlarged as stated).",
    "cloud": "Simulated tool points and the ellipse that holds 95 % of them.",
    "path": "Scatter along the path and where it comes from, and the joints.",
    "budget": "Which source the scatter comes from.",
    "plan_points": "Where the tool point goes to be measured, over all places that it may reach.",
    "plan_errors": "What the plan is made for, and each parameter by itself: the further left the better.",
    "map": "The best posture at every target of the grid: dark is good, hatched targets have none.",
    "map_bias": "How far off the target the arm lands without its corrections; arrows show which way (enlarged).",
    "map_spread": "The distance from its mean that the tool point keeps with 95 % probability: dark is good.",
    "joint_map": "The scatter over both joints: dark is good.",
    "bench": "The scatter over where the workpiece stands: dark is good, hatched is out of reach of some feature.",
    "compensation": "How far every target is missed with the given joint values, and expected with the compensated.",
    "landing": "Where the tool lands in the old posture and in the new one: ellipses hold 95 %.",
    "arm_comparison": "Where each posture lands about the target, as each arm predicts it: ellipses hold 95 %.",
    "residual_vectors": "Errors as arrows, from where the model says to where was measured (enlarged as stated).",
    "residual_joints": "Errors along each joint's motion, where it moves the tool: a line off zero is systematic.",
    "residual_inputs": "Mean errors with their 95 % bands over time, other inputs, and the side a joint came from.",
    "residual_region": "Errors of the calibrated model, and the ellipse that holds 95 % of them.",
    "residual_shape": "Errors of the calibrated model beside the normal distribution: on the line means normal.",
    "truth_coverage": "Measured rows in the predicted region of each probability: on the diagonal it is true.",
    "truth_joints": "How much each joint scatters: estimated with 95 % intervals, and as stated.",
    "batch": "How two parameters differ from robot to robot: the ellipse holds 95 % of the robots of the type.",
    "diagnosis_curves": "Each named effect (orange line) and what the data say of it with all else taken off.",
    "diagnosis_errors": "Errors of rows that the model had not seen, on one scale: row by row, and sorted.",
    "diagnosis_periodogram": "What each number of cycles a turn explains; above the dashed line it is no chance.",
    "diagnosis_left": "What the model with all its effects leaves: a line that leaves zero has no name yet.",
    "diagnosis_scores": "The causes in the model with their p-values, and what speaks for each candidate by itself.",
    "residual_repeats": "Repeats about their mean, with the ellipse that should hold 95 % of them.",
}
Files = dict[str, bytes]

_JSON = (
    *("solution", "spread", "calibration", "diagnosis", "plan", "map", "assessment", "spread_check"),
    *("comparison", "compensation"),
)
DOCUMENTS = frozenset((*(f"{name}.json" for name in _JSON), "report.txt", "report.html"))
OWN_FILES = DOCUMENTS | frozenset(
    (
        *(f"{name}{end}" for name in ("calibrated", "extended") for end in (".yaml", "_covariance.csv", ".urdf")),
        *("cloud.csv", "plan_points.csv", "uncertainty.yaml", "map.csv", "postures.csv", "compensated.csv"),
        *(f"{name}.{kind}" for name in CAPTIONS for kind in ("png", "svg")),
    )
)
"""Every name that a report's files may have: of an earlier run they would speak of another problem.

``plan.csv`` and ``split_measurements.csv`` are not among them: by then they may hold what was measured.
"""


def summary_html(summary: Summary) -> str:
    """A summary as a small table."""
    rows = "".join(f"<tr><th>{escape(label)}</th><td>{escape(text)}</td></tr>" for label, text in summary.facts)
    return f"<table><caption>{escape(summary.title)}</caption>{rows}</table>"


def report_files(
    name: str,
    document: dict[str, Any],
    page: Page,
    figures: Mapping[str, Figure],
    made: Callable[[bytes], bytes] = bytes,
) -> Files:
    """File name -> content of a report: its document as ``{name}.json``, report.txt, report.html, the figures.

    The page gets the figures; ``made`` is called with each picture and hands it back.
    """
    files = {f"{name}.json": (json_text(document) + "\n").encode(), "report.txt": render(page.report).encode()}
    images = {figure: made(image(drawn, "png")) for figure, drawn in figures.items()}
    files |= {f"{figure}.png": data for figure, data in images.items()}
    files |= {f"{figure}.svg": made(image(drawn, "svg")) for figure, drawn in figures.items()}
    return {**files, "report.html": replace(page, images=images, captions=CAPTIONS).html().encode()}


def save_files(folder: Path, files: Files) -> tuple[Path, ...]:
    """Writes files, by name, into ``folder``, all or none; those of an earlier report make room. The paths written.

    Raises:
        InputError: the folder cannot be written to.
    """
    former = {name for name in OWN_FILES if (folder / name).is_file()}
    with staged_folder(folder) as staging:
        for name, content in files.items():
            (staging / name).write_bytes(content)
    # A figure alone may be anybody's; a report of ours never comes without one of its documents.
    if former & DOCUMENTS:
        for name in former - set(files):
            (folder / name).unlink(missing_ok=True)
    return tuple(folder / name for name in files)
