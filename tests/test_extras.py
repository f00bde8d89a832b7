"""What is installed with the package, and what its extras bring: each with its reason, none needed by the core."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, distribution, requires
from importlib.util import find_spec

import pytest

from tests.helpers.fresh import ROOT

TEXT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
PROJECT = tomllib.loads(TEXT)["project"]
CORE: list[str] = PROJECT["dependencies"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
HEAVY = {
    "pandas",
    "distributed",
    "plotly",
    "viser",
    "trimesh",
    "jupyterlab",
    "sphinx",
    "ipykernel",
    "selenium",
    "pin",
    "torch",
    "sympy",
}
MOST_PACKAGES = 30  # that a bare installation brings; 25 on the day this was written

WITHOUT = """
import sys
for name in ("pandas", "plotly", "viser", "trimesh", "distributed", "IPython", "selenium", "pinocchio"):
    sys.modules[name] = None  # importing it fails, as where it is not installed
import posture_opt as po
from tempfile import TemporaryDirectory
solution = po.select_posture(po.load_problem("insert_planar_2r_fixed_hole"))
with TemporaryDirectory() as folder:
    print(len(solution.save(folder, figures=False)), solution._repr_html_()[:7])
"""


def name_of(requirement: str) -> str:
    return re.split(r"[\s\[<>=!~;(]", requirement, maxsplit=1)[0].lower()


def closure(names: list[str]) -> set[str]:
    """All installed distributions that some need, extras apart."""
    found: set[str] = set()
    while names:
        name = names.pop()
        if name in found:
            continue
        try:
            needed = requires(name) or []
        except PackageNotFoundError:  # of another platform
            continue
        found.add(name)
        names += [name_of(r) for r in needed if "extra ==" not in r]
    return found


def test_the_core_is_small_and_brings_nothing_heavy() -> None:
    assert len(CORE) <= 10
    every = closure([name_of(requirement) for requirement in CORE])
    assert len(every) <= MOST_PACKAGES
    assert not every & HEAVY


def test_the_core_works_without_any_extra() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], cwd=ROOT, capture_output=True, text=True, check=True)
    files, page = done.stdout.split()
    assert int(files) >= 3
    assert page == "<table>"


MODULES = {
    # extra -> modules that it brings; what is done with them beside the tests above
    "viewer": ("plotly",),
    "mesh": ("trimesh",),
    "notebook": ("jupyterlab", "pandas"),
    "explore": ("viser",),  # tests/explore
    "camera": ("cv2",),  # tests/measurements/test_board_detection.py
    "cluster": ("distributed",),  # tests/workers
    "docs": ("sphinx", "furo", "myst_nb", "sphinx_gallery"),  # the site, and the notebooks in it: `.ci/run`
    "test": ("pytest", "xdist", "pinocchio", "coal", "selenium", "pandas", "plotly", "distributed", "viser"),
    "bench": ("roboticstoolbox", "pydrake", "eaik", "pinocchio"),  # benchmarks/README.md
}


@pytest.mark.parametrize("extra", MODULES)
def test_what_an_extra_brings_is_there_under_its_name(extra: str) -> None:
    missing = [module for module in MODULES[extra] if find_spec(module) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} not installed: pip install 'posture_opt[{extra}]'")
    for requirement in EXTRAS[extra]:
        assert distribution(name_of(requirement)).version
