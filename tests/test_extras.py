"""What is installed with the package, and what its extras bring: each with its reason, none needed by the core."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, distribution, requires
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.page.page import plotly_js
from posture_opt.robot.urdf_shape import read_mesh
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


def test_with_viewer_the_library_of_the_view_stands_in_the_page() -> None:
    pytest.importorskip("plotly", reason="the extra viewer is not installed")
    assert len(plotly_js()) > 100_000


def test_with_mesh_the_meshes_of_a_urdf_are_read(tmp_path: Path) -> None:
    """A tetrahedron in the format of most URDF meshes, in millimetres."""
    pytest.importorskip("trimesh", reason="the extra mesh is not installed")
    corners = np.array([[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [0, 0, 1000]])
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners[list(face)])
        + "endloop\nendfacet\n"
        for face in [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    ]
    (tmp_path / "body.stl").write_text(f"solid body\n{''.join(facets)}endsolid body\n", encoding="utf-8")
    edges = read_mesh(tmp_path / "body.stl", (1e-3, 1e-3, 1e-3))
    lengths = np.unique(np.linalg.norm(edges.heads - edges.tails, axis=1).round(6))
    np.testing.assert_allclose(lengths, [1, np.sqrt(2)], atol=1e-6)  # three edges each, in m


def test_with_notebook_results_are_tables() -> None:
    pytest.importorskip("pandas", reason="the extra notebook is not installed")
    assert len(po.propagate(po.load_problem("insert_planar_2r"), [0.3, 0.5]).to_dataframe()) > 0


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
