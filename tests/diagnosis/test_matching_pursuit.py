"""The pursuit and its nested folds against plain least squares, and what is no candidate at all."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, list_candidates
from posture_opt.diagnosis.scores.nested_subsets import nested_subsets
from posture_opt.diagnosis.search.dictionary import Dictionary
from posture_opt.diagnosis.search.line_atoms import LineAtoms
from posture_opt.diagnosis.search.linearised_data import LinearisedData, linearise_calibration
from posture_opt.diagnosis.search.matching_pursuit import pursue_candidates, pursue_in_folds
from posture_opt.diagnosis.search.nested_selection import Folding, NestedSelection, clearly_less
from posture_opt.diagnosis.search.search import search_effects
from posture_opt.diagnosis.search.selection_criterion import substantial_members
from posture_opt.model.effects.cyclic_error import CyclicError
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m
LINE = 17.3  # cycles per revolution


def measured(folder: Path, q: np.ndarray, error: np.ndarray, rng: np.random.Generator) -> po.Measurements:
    write(folder / "data.csv", q, position(q + error) + rng.normal(0, NOISE, q.shape))
    return po.read_measurements(folder / "data.csv", po.problem_from_dict(PROBLEM))


@pytest.fixture(scope="module")
def two_errors(tmp_path_factory: pytest.TempPathFactory) -> LinearisedData:
    """A line of joint 1, and an eccentricity of joint 2."""
    rng = np.random.default_rng(71)
    q = rng.uniform(-2.5, 2.5, (160, 2))
    error = np.stack([1e-4 * np.sin(LINE * q[:, 0]), 4e-4 * np.sin(q[:, 1] + 0.3)], axis=1)
    data = measured(tmp_path_factory.mktemp("two"), q, error, rng)
    return linearise_calibration(po.calibrate(po.problem_from_dict(PROBLEM), data), 99)


def dictionary(linearised: LinearisedData) -> Dictionary:
    every = list_candidates(linearised.sensitivities, linearised.excitation, linearised.G)
    return Dictionary(linearised, tuple(c for c in every if c.named))


def left(columns: np.ndarray, r: np.ndarray) -> float:
    scaled = columns / np.where(np.linalg.norm(columns, axis=0) > 0, np.linalg.norm(columns, axis=0), 1.0)
    return float(np.sum((r - scaled @ np.linalg.lstsq(scaled, r, rcond=1e-9)[0]) ** 2))


def test_each_step_takes_what_least_squares_would(two_errors: LinearisedData) -> None:
    words = dictionary(two_errors)
    chosen = pursue_candidates(words, 2).chosen
    assert [(c.kind, c.target) for c in chosen] == [("gear_eccentricity", "joint2"), ("cyclic_error", "joint1")]
    assert chosen[1].what.cycles == pytest.approx(LINE, abs=2 * np.pi / 5.0 / 6)  # half a step of its grid
    # No candidate of one or two columns leaves less than the first that was taken.
    alone = {c.key: left(np.concatenate([two_errors.G, c.Z], axis=1), two_errors.r) for c in words.candidates}
    same = [value for key, value in alone.items() if key != chosen[0].key and key[0] != "instrument_field"]
    assert alone[chosen[0].key] < min(same)


def test_rows_that_are_held_out_teach_nothing(two_errors: LinearisedData) -> None:
    rows = np.arange(0, 160, 3)
    spoilt = two_errors.r.copy()
    spoilt.reshape(160, -1)[rows] += 1e3
    words, other = dictionary(two_errors), dictionary(replace(two_errors, r=spoilt))
    first, second = (pursue_candidates(d, 3, rows).chosen for d in (words, other))
    assert [str(c.what) for c in first] == [str(c.what) for c in second]
    assert [str(c.what) for c in pursue_candidates(other, 1).chosen] != [str(c.what) for c in first[:1]]


def test_pursuits_side_by_side_choose_what_each_chooses_alone(two_errors: LinearisedData) -> None:
    words, folds = dictionary(two_errors), [np.arange(k, 160, 4) for k in range(4)]
    together = list(pursue_in_folds(words, 4, folds))
    alone = [pursue_candidates(words, 4, rows) for rows in folds]
    assert [[str(c.what) for c in one.chosen] for one in together] == [[str(c.what) for c in o.chosen] for o in alone]


def test_a_line_is_taken_where_least_squares_has_it(two_errors: LinearisedData) -> None:
    (atoms,) = (a for a in dictionary(two_errors).atoms if isinstance(a, LineAtoms) and a.lines.form.joint == "joint1")
    learn = np.arange(len(two_errors.r)) % 10 > 1  # whole rows of x and y
    baseline = np.linalg.qr(two_errors.G * learn[:, None] / np.linalg.norm(two_errors.G, axis=0))[0]
    rest = two_errors.r * learn
    rest = rest - baseline @ (baseline.T @ rest)
    near = int(np.argmin(np.abs(atoms.lines.cycles - LINE)))
    found = atoms.finest(near, baseline, rest, learn)
    assert isinstance(found.what, CyclicError)
    step = float(np.diff(atoms.lines.cycles[:2])[0])
    grid = atoms.lines.cycles[near] + step * np.linspace(-0.5, 0.5, 129)
    columns = (atoms.lines.candidate(k, two_errors.sensitivities).Z * learn[:, None] for k in grid)
    losses = [left(np.concatenate([baseline, Z], axis=1), two_errors.r * learn) for Z in columns]
    assert found.what.cycles == pytest.approx(grid[int(np.argmin(losses))], abs=step / 32)


def test_subsets_are_those_of_least_loss_and_their_fits_those_of_least_squares() -> None:
    rng = np.random.default_rng(5)
    columns, known = [rng.normal(size=(90, k)) for k in (1, 2, 1, 3)], rng.normal(size=(90, 4)) * 1e3
    r = rng.normal(size=90) + columns[1] @ [3.0, 1.0] + 2 * columns[3][:, 0] + 0.5 * columns[0][:, 0]
    subsets = nested_subsets(columns, known, r)
    assert [len(s.members) for s in subsets] == [0, 1, 2, 3, 4]
    A = np.concatenate([known, *columns], axis=1)
    for smaller, larger in pairwise(subsets):
        assert set(smaller.members) < set(larger.members)
        losses = {
            gone: left(np.concatenate([known, *(columns[i] for i in larger.members if i != gone)], axis=1), r)
            for gone in larger.members
        }
        (gone,) = set(larger.members) - set(smaller.members)
        assert losses[gone] == min(losses.values())
        assert np.sum((r - A @ smaller.coefficients) ** 2) == pytest.approx(losses[gone], rel=1e-7)


def test_members_that_explain_next_to_nothing_go_one_by_one(two_errors: LinearisedData) -> None:
    """Against plain least squares of every subset, the least first; two of the six were added to the residuals."""
    members = [c for c in dictionary(two_errors).candidates if c.Z.shape[1] <= 2][:6]
    rng = np.random.default_rng(3)
    r = two_errors.r + 20 * sum(c.Z[:, 0] / np.linalg.norm(c.Z[:, 0]) for c in members[:2])
    linearised = replace(two_errors, r=r + rng.normal(size=len(r)))
    kept = list(members)

    def rss(some: list[Candidate]) -> float:
        return left(np.concatenate([linearised.G, *(c.Z for c in some)], axis=1), linearised.r)

    while len(kept) > 1:
        least, lost = rss(kept), [rss([c for c in kept if c is not gone]) for gone in kept]
        worst = int(np.argmin(lost))
        share = levels.MIN_EFFECT_SHARE * (rss([]) - least)
        if lost[worst] - least >= min(share, levels.MIN_EFFECT_RISE * least):
            break
        del kept[worst]
    assert 1 <= len(kept) < len(members)
    assert [str(c.what) for c in substantial_members(linearised, members)] == [str(c.what) for c in kept]


def test_what_left_out_rows_alone_show_explains_no_others(two_errors: LinearisedData) -> None:
    """A parameter of the left-out rows alone, in the others a mixture of all, and rounding in the shape of errors."""
    rng = np.random.default_rng(12)
    rows = np.arange(0, 160, 3)
    own = np.repeat(np.isin(np.arange(160), rows), 2)
    r = two_errors.r + 50 * own * rng.normal(size=len(own))
    shown = own * r + two_errors.G @ rng.normal(size=two_errors.G.shape[1]) * 1e-7 + 1e-9 * ~own * r
    with_it, without = (replace(two_errors, r=r, G=G) for G in (np.column_stack([two_errors.G, shown]), two_errors.G))
    one, other = (pursue_candidates(dictionary(linearised), 2, rows).chosen for linearised in (with_it, without))
    assert [str(c.what) for c in one] == [str(c.what) for c in other]
    subset = nested_subsets([], with_it.G, r, ~own)[0]
    assert np.sum((r - with_it.G @ subset.coefficients)[~own] ** 2) == pytest.approx(left(two_errors.G[~own], r[~own]))


def test_held_out_errors_are_those_of_a_fit_to_the_other_rows(two_errors: LinearisedData) -> None:
    residuals = two_errors.sensitivities.residuals
    (folding,) = Folding.usual(residuals.data)[:1]
    nested = NestedSelection.of(dictionary(two_errors), 2, folding.groups, folding.folds)
    rows = folding.folds[0]
    index = (rows[:, None] * residuals.block + np.arange(residuals.block)).ravel()
    learn = np.setdiff1d(np.arange(len(two_errors.r)), index)
    A = np.concatenate([two_errors.G, *(two_errors.sensitivities.columns(e) for e in nested.sets[0][2])], axis=1)
    A = A / np.linalg.norm(A, axis=0)
    e = two_errors.r - A @ np.linalg.lstsq(A[learn], two_errors.r[learn], rcond=1e-9)[0]
    squares = np.sum((e[index].reshape(len(rows), -1) * residuals.sigma) ** 2, axis=1)
    np.testing.assert_allclose(nested.losses[2, rows], squares, rtol=1e-5, atol=1e-16)
    assert nested.least == 2
    assert not nested.refuted


def test_one_standard_error_is_that_of_paired_differences() -> None:
    common = np.random.default_rng(8).exponential(size=400) * 100
    unlike = np.tile([1.0, -1.0], 200)  # of sum zero; a standard error of their sum is 20
    assert clearly_less(common - 0.06 + unlike, common)
    assert not clearly_less(common - 0.04 + unlike, common)


def test_lines_of_one_joint_are_one_cause_led_by_the_largest(tmp_path: Path) -> None:
    rng = np.random.default_rng(73)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    wheel = sum(a * np.sin(n * 40 * q[:, 0] + n) for n, a in ((1, 2e-4), (2, 1.5e-4), (4, 1e-4)))
    data = measured(tmp_path, q, np.stack([wheel, 0 * wheel], axis=1), rng)
    found = po.diagnose(po.problem_from_dict(PROBLEM), data, plan=False)
    (gear,) = [f for f in found.effects if f.kind == "cyclic_error"]
    assert gear.effect.cycles == pytest.approx(40, abs=0.1)
    assert "of 3 lines (40.0, 80.0 and 160.0 cycles per revolution)" in gear.cause.words
    together, each = gear.cause.sizes(gear.sizes)
    assert "(harmonic 2)" in each.text
    assert "(harmonic 4)" in each.text
    assert "what comes 40.0 times" in found.to_json()["effects"][0]["inspect"]
    # Waves of 0.2, 0.15 and 0.1 mrad: sqrt((0.2² + 0.15² + 0.1²) / 2) = 0.190 mrad.
    assert together.text.startswith("0.19")
    assert found.errors["extended"].rms < 1.15 * np.sqrt(2) * NOISE
    # The file holds all lines, and does the same to the data.
    again = found.extended.effects[0]
    assert again.lines == pytest.approx(gear.effect.lines)
    assert found.to_json()["residual_rms"]["delivered"] < 1.05 * np.sqrt(2) * NOISE


def test_joint_values_that_cannot_tell_lines_apart(tmp_path: Path) -> None:
    assert not len(CyclicError.resolved(np.repeat(np.linspace(-1, 1, 7), 20)))  # any seven errors fit some line
    grid = np.repeat(np.arange(-2.4, 2.41, np.pi / 18), 5)  # every 10°: k and 36 − k are one
    assert CyclicError.resolved(grid).max() <= 18.0 + 1e-9
    irregular = np.random.default_rng(4).uniform(-2.4, 2.4, 100)
    assert CyclicError.resolved(irregular).max() > 290
    rng = np.random.default_rng(74)
    q = np.stack([rng.choice(np.unique(grid), 200), rng.uniform(-2.5, 2.5, 200)], axis=1)
    data = measured(tmp_path, q, np.stack([2e-4 * np.sin(30 * q[:, 0] + 1), np.zeros(200)], axis=1), rng)
    linearised = linearise_calibration(po.calibrate(po.problem_from_dict(PROBLEM), data), 99)
    found = search_effects(linearised)
    lines = [s.what.cycles for s in (*found.chosen, *found.rivals[0]) if isinstance(s.what, CyclicError)]
    assert min(lines) == pytest.approx(6, abs=0.3)
    assert any(abs(cycles - 30) < 0.3 for cycles in lines)  # the true one is named among its aliases
