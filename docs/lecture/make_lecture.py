"""Writes lecture.md and its figures: every number in them is computed here.

python docs/lecture/make_lecture.py            # text and figures
python docs/lecture/make_lecture.py --text     # the text alone
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import jinja2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from lecture_format import e4, mm, number, percent, probability, sci, thousands
from lecture_numbers import (
    EXAMPLES,
    K95,
    K95_SMALL,
    K95_SPACE,
    SMALL,
    TWO_SIGMA,
    TWO_SIGMA_LINE,
    Chance,
    Closing,
)
from lecture_rules import COVERED, GRIPPER, K_LINE, K_POSE, KlineMcClintock, MeasuringRobot, Pose, Times
from lecture_tables import (
    AXES,
    axes_table,
    chance_table,
    consistency_table,
    correlated_table,
    coverage_table,
    example_table,
    kline_table,
    length_table,
    place_table,
    pose_table,
    reading_table,
    rule_table,
    scalar_counts,
    time_table,
)

FOLDER = Path(__file__).resolve().parent


def text() -> str:
    """The whole document."""
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True, autoescape=False)
    environment.filters |= {f.__name__: f for f in (math.sqrt, number, e4, mm, percent, probability, sci, thousands)}
    template = environment.from_string((FOLDER / "lecture.md.j2").read_text(encoding="utf-8"))
    closing, kline, pose, measure, times = Closing(), KlineMcClintock(), Pose(), MeasuringRobot(), Times.read()
    length_u = K_LINE * measure.length_sigma((True, True))
    return template.render(
        examples=EXAMPLES, example_table=example_table, consistency_table=consistency_table(), chance=Chance,
        chance_table=chance_table(), coverage_table=coverage_table(), correlated_table=correlated_table(),
        closing=closing, place_table=place_table, optima=closing.optima, rivals=closing.rivals,
        angles_only=closing.angles_only, two_sigma=TWO_SIGMA, two_sigma_line=TWO_SIGMA_LINE, k95_space=K95_SPACE,
        k95=K95, k95_small=K95_SMALL, small=SMALL, sqrt=math.sqrt,
        axes=AXES, axes_table=axes_table(), rule_table=rule_table(), reading_table=reading_table(),
        scalar_counts=scalar_counts(), covered=COVERED, covered_literally=1 - math.exp(-1), kline=kline,
        kline_table=kline_table(kline), times=times, time_table=time_table(times), pose_table=pose_table(pose),
        gripper=GRIPPER, tip=pose.tip(together=True), tip_apart=pose.tip(together=False), k_pose=K_POSE,
        measure=measure, k_line=K_LINE, length_table=length_table(measure), length_u=length_u,
        overstated=measure.length_sigma((False, False)) / measure.length_sigma((True, True)),
        degree=math.pi / 180, smaller=lambda C: np.linalg.eigvalsh(C)[0],
    )  # fmt: skip


def main() -> None:
    (FOLDER / "lecture.md").write_text(text(), encoding="utf-8")
    if "--text" not in sys.argv:
        from lecture_figures import write_figures

        write_figures(FOLDER / "figures", Closing())


if __name__ == "__main__":
    main()
