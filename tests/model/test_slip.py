"""The moments at which a slip is looked for: enough rows on either side tell it from a few that are off."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from posture_opt.model.effects import Excitation
from posture_opt.model.effects.slip import Slip
from posture_opt.problem.load import load_problem

ROBOT = load_problem("insert_planar_2r").robot


@pytest.mark.parametrize(("rows", "least"), [(150, 10), (400, 10), (24, 6)])
def test_a_slip_has_rows_on_either_side_of_its_moment(rows: int, least: int) -> None:
    times = np.sort(np.random.default_rng(rows).uniform(0, 3600, rows))
    times -= times[0]
    case = Excitation(ROBOT, frozenset({"time"}), (1.0, 1.0), float(times[-1]), tuple(times.tolist()))
    moments = {effect.moment for effect in Slip.candidates(case)}
    assert moments
    assert all(least <= np.sum(times < moment) <= rows - least for moment in moments)
    state = SimpleNamespace(inputs=SimpleNamespace(time=times))
    for start in (times[2], times[rows // 2], times[-2]):
        steps = Slip(of="base", moment=f"{start} s").shape_steps(state)
        assert all(least <= np.sum(times < moment) <= rows - least for moment in steps)
    middle = Slip(of="base", moment=f"{times[rows // 2]} s").shape_steps(state)
    assert len(middle)
