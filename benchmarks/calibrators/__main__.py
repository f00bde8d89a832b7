"""One way at one task, in a process of its own: ``python -m benchmarks.calibrators WAY TASK.npz FOLDS.json``.

FOLDS has lists of learned and asked rows. The answers are the last line, as JSON; CPU times are of the fits alone.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
import warnings
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from benchmarks.calibrators import Task


def _version(package: str) -> str:
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return package  # run from its source


def main(way: str, task_file: str, folds_file: str) -> None:
    warnings.simplefilter("ignore")
    module = importlib.import_module(f"benchmarks.calibrators.{way}")
    task, answers = Task.load(Path(task_file)), []
    for learned, asked in json.loads(Path(folds_file).read_text()):
        began = time.process_time()
        found = module.fit(task, np.array(learned), np.array(asked))
        answers.append(
            {
                "seconds": time.process_time() - began,
                "squares": np.sum(found.errors**2, axis=1).tolist(),
                "stated": found.stated,
                "sizes": found.sizes,
                "parameters": found.parameters,
            }
        )
    versions = ", ".join(map(_version, module.PACKAGES))
    print("\n" + json.dumps({"title": module.TITLE, "versions": versions, "answers": answers}))


if __name__ == "__main__":
    main(*sys.argv[1:])
