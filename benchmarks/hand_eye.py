"""Pictures of a board: the calibrated arm beside OpenCV's hand-eye calibrations, which hold the arm.

`python -m benchmarks.hand_eye`, a minute or two; `--draws 4` for a look. Arms with errors of 0.5 mm and 0.5 mrad take
30 pictures with a noise of 0.2 px; judged is where each way puts the corners of 40 others. OpenCV 4 is needed:
version 5 has no hand-eye calibration.
"""

from __future__ import annotations

import argparse
import tempfile
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks.machine import machine_line
from benchmarks.tables import table
from tests.helpers.hand_eye import METHODS, SCENES, errors_of


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=12, help="arms with other errors")
    draws = parser.parse_args().draws
    cv2 = import_module("cv2")
    columns = []
    with tempfile.TemporaryDirectory() as folder:
        for where in SCENES:
            found = [errors_of(cv2, where, Path(folder), seed) for seed in range(draws)]
            columns.append(np.median([[ours, held, *theirs] for ours, held, theirs in found], axis=0))
    names = ("calibrated", "arm held", *(f"OpenCV, {name}" for name in METHODS))
    rows = [(name, *(1e3 * float(column[k]) for column in columns)) for k, name in enumerate(names)]
    headers = ("RMS error [mm], median", *(f"camera: {where}" for where in SCENES))
    print(table(headers, rows, ("", ".2f", ".2f")))
    print(f"{draws} arms; OpenCV {cv2.__version__}; {machine_line()}")


if __name__ == "__main__":
    main()
