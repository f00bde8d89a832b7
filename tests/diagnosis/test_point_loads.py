"""What yields to gravity is found without the masses of the links too: joints, links and base, as products of load.

The simulator of ``tests/hidden`` has masses and shares no code with the package; the file that is handed over has none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.hidden.draw import draw
from tests.hidden.files import write
from tests.hidden.hunt import ask

SEED, STRONG = 12, 100.0


def without_masses(folder: Path, family: str, kind: str, index: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """What was hidden, and the answer where the file states no masses."""
    case = draw(SEED, family, index, kind=kind, weakest=STRONG)
    file = write(case, folder)
    problem = yaml.safe_load(file.read_text())
    for joint in problem["robot"]["joints"]:
        joint.pop("mass", None)
        joint.pop("com", None)
    file.write_text(yaml.safe_dump(problem, sort_keys=False))
    return case.truth["effects"][0], ask(folder)


CASES = [("base_compliance", 0), ("link_bending", 1), ("joint_compliance", 2)]


@pytest.mark.long
@pytest.mark.parametrize(("kind", "index"), CASES)
def test_two_payloads_give_the_compliance_itself(kind: str, index: int, tmp_path: Path) -> None:
    truth, answer = without_masses(tmp_path, "full", kind, index)
    moving = [e for e in answer["effects"] if "compliance" in e["kind"] or e["kind"] == "link_bending"]
    assert moving
    first = moving[0]
    inside = [(first["kind"], first["target"]), *((r["kind"], r["target"]) for r in first["confounded_with"])]
    assert (kind, truth["target"]) in inside
    if inside[0] == (kind, truth["target"]):
        found = first["estimate"]["compliance"]
        assert abs(found["value"] - next(iter(truth["size"].values()))) < 4 * found["std"]
