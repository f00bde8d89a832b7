"""``optimize-posture calibrate``: the parameters of the arm from measurements, and what they bring."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.options import Common, common_options, problem_options
from posture_opt.cli.output import Answer, output_folder, progress_bar, show
from posture_opt.cli.request import placed, requested_problem


@click.command("calibrate")
@click.argument("data", type=click.Path(path_type=Path), metavar="DATA.csv")
@problem_options
@click.option(
    "--test", type=click.Path(path_type=Path), metavar="OTHER.csv", help="Other measurements, to be predicted."
)
@click.option("--refit-frames", is_flag=True, help="Fit base and tool again to the test file.")
@click.option("--no-priors", is_flag=True, help="Let the σ's of the problem file not count as knowledge.")
@click.option(
    "--by",
    type=click.Choice(["pose", "block", "place"]),
    help="What the cross-validation leaves out together: a pose, a block of the workspace, a touched place.",
)
@click.option("--folds", type=click.IntRange(min=2), default=5, show_default=True, help="Of the cross-validation.")
@click.option("--no-plan", is_flag=True, help="Do not plan the task anew with the calibrated arm.")
@common_options
def command(
    common: Common, data: Path, test: Path | None, refit_frames: bool, no_priors: bool, by: Any, folds: int,
    no_plan: bool, **given: Any,
) -> None:  # fmt: skip
    """What the simulation gets wrong, and the parameters of the arm that the measurements determine."""
    if refit_frames and test is None:
        raise click.UsageError("--refit-frames goes with --test.")
    problem = requested_problem(**given)
    with output_folder(common.out) as folder, placed(problem):
        measured = po.read_measurements(data, problem)
        if len(measured.robot_names) > 1:
            if test is not None:
                raise click.UsageError("--test goes with measurements of one robot, and the data are of several.")
            from posture_opt.cli.calibrate_batch import calibrated_batch

            document, text = calibrated_batch(common, folder, problem, measured, folds, by)
        else:
            other = None if test is None else po.read_measurements(test, problem)
            how = {"priors": not no_priors, "folds": folds, "by": by, "test": other, "refit_frames": refit_frames}
            document, text = _calibrated(common, folder, problem, measured, how, not no_plan)
    show(common, document, text)


def _calibrated(
    common: Common, folder: Path | None, problem: Any, measured: po.Measurements, how: dict[str, Any], plan: bool
) -> Answer:
    """Calibrates one robot, writes the files, and returns what can be shown."""
    with progress_bar(common, "calibrating") as progress:
        found = po.calibrate(problem, measured, **how, progress=progress)
    from posture_opt.problem.calibrated import replanned
    from posture_opt.report.calibration_report import Learned

    learned = Learned(
        measured, found, how["folds"], how["priors"], how["test"], how["refit_frames"],
        calibrated=(calibrated := po.calibrated_problem(problem, found)),
        assessment=po.assess(problem, measured, found),
        spread_check=po.check_spread(problem, measured, found, folds=how["folds"]),
        replanned=replanned(problem, found, calibrated, seed=common.seed) if plan else None,
    )  # fmt: skip
    if folder is not None:
        from posture_opt.report.write import write_calibration

        write_calibration(folder, problem, learned, common.plots)

    def text() -> str:
        from posture_opt.report.text import calibration_text

        return calibration_text(problem, learned)

    def document() -> dict[str, Any]:
        from posture_opt.report.write import calibration_document

        return calibration_document(learned)

    return document, text
