"""The files of a report: JSON, text, CSV, one page with the figures inside, figures as PNG and SVG; all or none."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posture_opt.encoding import json_text
from posture_opt.numerics import Array, Json, Mask
from posture_opt.output import manifest_of, write_folder
from posture_opt.report.page.page import Page
from posture_opt.report.page.style import image
from posture_opt.report.text.blocks import Summary
from posture_opt.report.text.text import render
from posture_opt.texts import csv_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CAPTIONS = {
    "arm": "The arm in its posture, with the 95 % region of the tool point (enlarged as stated).",
    "cloud": "Simulated tool points and the predicted 95 % ellipse.",
    "path": "Standard deviation along the path, its main contributions, and the joint values.",
    "budget": "Contribution of each error source to the variance.",
    "plan_points": "Planned positions of the tool point, over its reachable workspace.",
    "plan_errors": "Criterion of the plan, and expected standard error of each parameter; further left is better.",
    "map": "Standard deviation in the best posture at every target: darker is better; others: what fails there.",
    "map_bias": "Mean error without the corrections; arrows show its direction (enlarged).",
    "map_spread": "95 % radius of the tool point about its mean: darker is better.",
    "joint_map": "Standard deviation over both joint values: darker is better.",
    "bench": "Standard deviation over the workpiece placement: darker is better; hatched: some feature is infeasible.",
    "compensation": "Error at every target with the given joint values, and expected error after compensation.",
    "predicted_error": "Predicted tool point in the old and in the new posture, with 95 % ellipses.",
    "arm_comparison": "Predicted tool point of each posture about the target, by each arm, with 95 % ellipses.",
    "answers": "Standard deviation of each problem that has a solution, in order.",
    "residual_vectors": "Position errors as arrows from the predicted to the measured point (enlarged as stated).",
    "residual_joints": "Position errors along the motion of each joint: a trend away from zero is systematic.",
    "residual_inputs": "Mean errors with 95 % bands over time, other inputs and the approach side of each joint.",
    "residual_region": "Residuals of the calibrated model and their 95 % ellipse.",
    "residual_shape": "Normal probability plot of the residuals: points on the line are normally distributed.",
    "truth_coverage": "Coverage of the predicted regions: on the diagonal, the predicted spread is correct.",
    "truth_joints": "Scatter of each joint: estimates with 95 % intervals, and the stated values.",
    "batch": "Variation of two parameters between robots, with the 95 % ellipse of the type.",
    "recheck_changes": "Probability of each possible change, and how far it would move the tool.",
    "recheck_rows": "Position error of every row, with the arm of the file and with what changed.",
    "diagnosis_curves": "Each identified effect (line) and the partial residuals of the data.",
    "diagnosis_errors": "Errors on held-out rows, by row and sorted.",
    "diagnosis_periodogram": "Periodogram over cycles per revolution; above the dashed threshold is significant.",
    "diagnosis_left": "Residuals of the model with all effects: a trend away from zero is unexplained.",
    "diagnosis_scores": "Causes in the model with their p-values, and the score of each candidate on its own.",
    "residual_repeats": "Repeats about their mean, with the predicted 95 % ellipse.",
}
Files = dict[str, bytes]

_JSON = (
    *("solution", "spread", "calibration", "diagnosis", "plan", "map", "assessment", "spread_check"),
    *("comparison", "compensation", "answers", "recheck"),
)
_ARMS = ("calibrated", "extended", "rechecked")
ALWAYS = frozenset(("report.txt", "report.html"))
"""What every report writes."""

OWN_FILES = frozenset(
    {
        *ALWAYS,
        *(f"{name}.json" for name in _JSON),
        *(f"{name}{end}" for name in _ARMS for end in (".yaml", "_covariance.csv", ".urdf")),
        *(f"{name}.csv" for name in ("cloud", "plan_points", "map", "postures", "compensated", "answers")),
        *(f"{name}.{kind}" for name in CAPTIONS for kind in ("png", "svg")),
        "uncertainty.yaml",
    }
)
"""Every name that a report's files may have: of an earlier run they would speak of another problem.

``plan.csv`` and ``split_measurements.csv`` are not among them: by then they may hold what was measured.
"""


_OWN_PAGE = re.compile(r"report_\d+_[\w-]*\.html", re.ASCII)


def page_name(number: int, title: str) -> str:
    """File name of the page of one of many answers.

    Example:
        >>> page_name(3, "cells/left arm.yaml")
        'report_3_left_arm.html'
    """
    return f"report_{number}_{re.sub(r'[^A-Za-z0-9-]+', '_', Path(title).stem)[:60]}.html"


def summary_html(summary: Summary) -> str:
    """A summary as a small table: a caption and a row a fact, texts escaped."""
    rows = "".join(f"<tr><th>{escape(label)}</th><td>{escape(text)}</td></tr>" for label, text in summary.facts)
    return f"<table><caption>{escape(summary.title)}</caption>{rows}</table>"


def report_files(
    name: str,
    document: Mapping[str, Json],
    page: Page,
    figures: Mapping[str, Figure],
    made: Callable[[bytes], bytes] = bytes,
) -> Files:
    """File name -> content of a report: its document as ``{name}.json``, report.txt, report.html, the figures."""
    files = {f"{name}.json": (json_text(document) + "\n").encode(), "report.txt": render(page.report).encode()}
    images = {figure: made(image(drawn, "png")) for figure, drawn in figures.items()}
    files |= {f"{figure}.png": data for figure, data in images.items()}
    files |= {f"{figure}.svg": made(image(drawn, "svg")) for figure, drawn in figures.items()}
    return {**files, "report.html": replace(page, images=images, captions=CAPTIONS).html().encode()}


def save_files(folder: Path, files: Files) -> tuple[Path, ...]:
    """Writes files, by name, into ``folder``, all or none, and returns their paths.

    Files of an earlier report are removed: they would be of another problem.

    Raises:
        InputError: the folder cannot be written to, or has a file of such a name that is not of this program.
    """
    pages = {name for name, _ in manifest_of(folder) if _OWN_PAGE.fullmatch(name)}
    return write_folder(folder, files, replaces=OWN_FILES | pages)


def map_csv(columns: Mapping[str, Sequence[Any] | Array | Mask], joints: int, decimals_of_joints: int = 6) -> str:
    """The table of a map as a file: places to 0.1 µm, joints to so many decimals of deg or mm, the rest to six."""
    headers = list(columns)
    decimals = dict.fromkeys(headers[:3], 4) | {"feasible": 0, "listed": 0}
    decimals |= dict.fromkeys(headers[-joints:], decimals_of_joints)
    styles = {head: f".{decimals[head]}f" if head in decimals else ".6g" for head in headers}
    cells = [["" if math.isnan(v) else format(v + 0.0, styles[head]) for v in columns[head]] for head in headers]
    return "".join(csv_line(row) + "\n" for row in (headers, *zip(*cells, strict=True)))
