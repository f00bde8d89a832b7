"""Free frames in small volumes at constant orientation: base and tool stay near, and the errors are noise.

Seeds 100 to 106 were used while the method was chosen; those here were not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.small_volume import NOISE, small_volume
from tests.helpers.variants import conformance
from tests.hidden.files import write


@pytest.mark.parametrize(
    ("seed", "name", "rows", "tilt", "digits"),
    conformance(
        [
            (700, "ur10", 60, 0.0, 9),
            (703, "kr16", 60, 0.0, 2),
            (704, "ur10", 100, 0.02, 4),
            (705, "seven", 60, 0.001, 3),
        ],
        always=[(704, "ur10", 100, 0.02, 4)],
    ),
)
def test_frames_stay_near_and_errors_are_noise(
    seed: int, name: str, rows: int, tilt: float, digits: int, tmp_path: Path
) -> None:
    case, arm = small_volume(seed, name, rows, tilt=tilt, digits=digits)
    problem = po.load_problem(write(case, tmp_path))
    found = po.calibrate(problem, po.read_measurements(tmp_path / "data.csv", problem))
    value = {p.name: p.nominal + x for p, x in zip(found.parameters, found.x, strict=True)}
    for frame, factors in (("base", arm.base), ("tool", arm.tool)):
        off = [value[f"{frame}.{axis}"] - f.value for axis, f in zip("xyz", factors[:3], strict=True)]
        assert np.linalg.norm(off) < 0.5  # m: far less than the arms' reach of 1.1 to 1.8
    fitted = np.sqrt(np.mean(np.sum(found.errors_fitted**2, axis=1)))
    assert fitted < np.sqrt(3) * NOISE * 1.1
    assert found.calibrated.rms < np.sqrt(3) * NOISE * 1.5
    # At constant orientation nothing tells base and tool apart, and that is said.
    if not tilt:
        assert "tool." in " ".join(found.identifiability.words)
        where = [p.name for p in found.parameters].index("tool.x")
        assert not found.fixed[where] or found.std[where] > 0.01
