"""The command: `python -m benchmarks.results` writes RESULTS.md and its figures beside the other benchmarks."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.machine import load, machine_line
from benchmarks.results import PARTS
from benchmarks.results.figure import drawn
from benchmarks.results.parts import BEGIN, Outcome, measured, run
from posture_opt.report.page.style import image

FOLDER = Path(__file__).parents[1]
PICTURES = "results/figures"
KEPT = "results/calibration_peers.md"  # measured by itself: it needs real arms and interpreters of the peers' own
LIMIT = 400.0  # s a part; measuring 10 000 rows takes the longest
PACKAGES = (
    "posture_opt", "casadi", "numpy", "scipy", "pin", "roboticstoolbox-python", "drake", "EAIK", "pytracik", "pyroki",
    "jax",
)  # fmt: skip


def page(outcomes: Sequence[Outcome], before: str, quick: bool, folder: Path) -> Iterator[str]:
    """The lines of RESULTS.md; the figures are written into the folder on the way."""
    yield from ("# Results", "")
    yield f"Written by `python -m benchmarks.results{' --quick' if quick else ''}`; what was measured, and how, stands"
    yield "in [README.md](README.md). Every way has one thread unless the table says otherwise; the ways of a table ran"
    yield "side by side, so that ratios hold where times do not."
    yield ""
    yield f"- Run: {before}; {sum(o.seconds for o in outcomes) / 60:.1f} minutes."
    yield f"- Machine: {machine_line(*PACKAGES)}."
    yield ""
    for outcome in outcomes:
        if outcome.reason:
            yield from (f"## {outcome.part}", "", f"Not measured: {outcome.reason}.", "")
        for section in outcome.sections:
            if section.chart is not None and section.rows:
                (folder / PICTURES).mkdir(parents=True, exist_ok=True)
                (folder / PICTURES / f"{section.key}.svg").write_bytes(image(drawn(section, section.chart), "svg"))
            yield from section.markdown(f"{PICTURES}/{section.key}.svg" if section.chart and section.rows else None)
    yield (FOLDER / KEPT).read_text(encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer targets, sizes and repeats: three minutes")
    parser.add_argument("--only", choices=PARTS, nargs="+", help="these parts alone")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of RESULTS.md")
    parser.add_argument("--part", choices=PARTS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part:
        print(BEGIN + measured(given.part, given.quick))
        return
    before = f"{time.strftime('%Y-%m-%d %H:%M', time.gmtime())} UTC, {load()}"
    outcomes = []
    for part in given.only or PARTS:
        outcomes.append(run(part, given.quick, LIMIT))
        print(f"{part}: {outcomes[-1].reason or 'measured'}, {outcomes[-1].seconds:.0f} s", file=sys.stderr)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "RESULTS.md").write_text("\n".join(page(outcomes, before, given.quick, given.out)), encoding="utf-8")


if __name__ == "__main__":
    main()
