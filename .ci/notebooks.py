"""Runs the notebooks of the documentation: ``python .ci/notebooks.py [--write] [NAME ...]``, by stem.

Each runs in a folder of its own, as the documentation site runs it, and has to end without an error. ``--write`` keeps
the outputs, with nothing in them that tells when or where they were made.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
MOST = 120  # s for one cell


def run(path: Path, write: bool) -> None:
    """Runs one notebook; raises ``CellExecutionError`` with the cell that fails."""
    notebook = nbformat.read(path, as_version=4)
    begun = time.monotonic()
    with TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=MOST, resources={"metadata": {"path": folder}}, record_timing=False).execute()
    print(f"{path.stem}: {time.monotonic() - begun:.0f} s", flush=True)
    if write:
        notebook.metadata = {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        }
        nbformat.write(notebook, path)


def main(words: list[str]) -> None:
    """All notebooks, or those that are named."""
    stems = [word for word in words if not word.startswith("-")]
    paths = [FOLDER / f"{stem}.ipynb" for stem in stems] or sorted(FOLDER.glob("*.ipynb"))
    for path in paths:
        run(path, "--write" in words)


if __name__ == "__main__":
    main(sys.argv[1:])
