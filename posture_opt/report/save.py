"""The files of a report: JSON, text and page, figures as PNG and SVG, in a folder that gets all of them or none."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posture_opt import __version__
from posture_opt.output import json_text, staged_folder
from posture_opt.report.blocks import Report
from posture_opt.report.html import CAPTIONS, report_html
from posture_opt.report.style import image
from posture_opt.report.text import render

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Files = dict[str, bytes]

_JSON = ("solution", "spread", "calibration", "diagnosis", "plan", "map", "assessment", "spread_check")
DOCUMENTS = frozenset((*(f"{name}.json" for name in _JSON), "report.txt", "report.html"))
OWN_FILES = DOCUMENTS | frozenset(
    (
        *(f"{name}{end}" for name in ("calibrated", "extended") for end in (".yaml", "_covariance.csv", ".urdf")),
        *("cloud.csv", "plan_points.csv", "uncertainty.yaml", "map.csv"),
        *(f"{name}.{kind}" for name in CAPTIONS for kind in ("png", "svg")),
    )
)
"""Every name that a report's files may have: of an earlier run they would speak of another problem.

``plan.csv`` and ``split_measurements.csv`` are not among them: by then they may hold what was measured.
"""


def report_files(
    name: str, document: dict[str, Any], report: Report, figures: Mapping[str, Figure], problem_file: str
) -> Files:
    """File name -> content of a report: its document as ``{name}.json``, report.txt, report.html, the figures."""
    files = {f"{name}.json": (json_text(document) + "\n").encode(), "report.txt": render(report).encode()}
    images = {figure: image(drawn, "png") for figure, drawn in figures.items()}
    files |= {f"{figure}.png": data for figure, data in images.items()}
    files |= {f"{figure}.svg": image(drawn, "svg") for figure, drawn in figures.items()}
    return {**files, "report.html": report_html(report, images, __version__, problem_file).encode()}


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
