"""What every listed effect has to keep to: file, schema, derivatives, words, figure, shape, and that a search finds it.

A new effect is tested by its line in the list; one that the simulator of ``tests/hidden`` does not have is searched for
in data of its own forward model.
"""

from __future__ import annotations

import json
import re
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects import CATALOGUE, EFFECTS, NOISES, CatalogueEntry, Effect, FittedSizes
from posture_opt.report.figures.diagnosis_curves import plot_curves
from tests.helpers.effect_cases import SHAPES, excitation, instances, one_row, read, sized, with_effects
from tests.helpers.variants import conformance
from tests.hidden.draw import draw
from tests.hidden.families import FAMILIES
from tests.hidden.files import write
from tests.hidden.noise import SIGMA
from tests.hidden.sizes import KINDS

STRONG = 60.0  # λ: missed once in a hundred thousand
JARGON = ("gives way", "has play", "stands elsewhere", "comes back", "by chance", "a turn")
UNITS = r"\d .*(mrad|arcsec|deg|µrad|µm|ppm|mm|ms|min|rows|%)"
NOISE_ENTRIES: dict[str, dict[str, Any]] = {
    "joint_noise": {"joint": "elbow", "sigma": "0.1 mrad"},
    "range_noise": {"a": "15 um", "b": "6 um/m"},
    "stated_sigma": {"factor": 1.8},
    "outliers": {"share": 0.02},
    "correlated_lengths": {"lengths": ["shoulder_lift.a", "elbow.a"], "rho": 0.8},
}
NOISE_SIZES: dict[str, dict[str, tuple[float, float, str]]] = {
    "joint_noise": {"sigma": (1e-4, 1e-5, "rad")},
    "range_noise": {"growth": (0.7, 0.1, "1")},
    "stated_sigma": {"factor": (1.8, 0.1, "1")},
    "outliers": {"count": (5.0, float("nan"), "1")},
    "correlated_lengths": {"correlation": (0.8, 0.1, "1")},
}


every_effect = pytest.mark.parametrize("cls", EFFECTS, ids=lambda cls: cls.kind_name())
every_arm = pytest.mark.parametrize("arm", conformance(SHAPES, ["ur10"]))


@every_arm
@every_effect
def test_numbers_arrays_and_symbols_agree(cls: type[Effect], arm: str, sites: Any) -> None:
    site, robot, inputs = sites[arm]
    rng = np.random.default_rng(1)
    for effect in instances(cls, site, robot)[:2]:
        effect = sized(effect, rng)
        many = with_effects(robot, (effect,), inputs).pose(site.session.q)
        for row in (0, 17):
            one = with_effects(robot, (effect,), one_row(inputs, row))
            q = site.session.q[row]
            np.testing.assert_allclose(one.pose(q), many[row], atol=1e-14)
            if row:
                continue
            symbolic = ca.Function("f", [one.q], [one.pose(one.q)])
            np.testing.assert_allclose(np.array(symbolic(q)), many[row], atol=1e-13)
            p = ca.SX.sym("p", len(one.parameters))
            both = ca.Function("f", [one.q, p], [one.pose(one.q, p)])
            np.testing.assert_allclose(np.array(both(q, 0)), many[row], atol=1e-13)


@every_arm
@every_effect
def test_columns_are_the_derivatives_by_the_parameters(cls: type[Effect], arm: str, sites: Any) -> None:
    """Shift and small rotation per unit of each parameter, by central differences about the plain chain."""
    site, robot, inputs = sites[arm]
    effects = instances(cls, site, robot)
    assert effects or (arm == "scara" and cls.kind_name() == "link_bending")
    for effect in effects:
        model = with_effects(robot, (effect,), one_row(inputs, 3))
        q, k = site.session.q[3], len(model.parameters)
        own = range(k - len(effect.parameter_names), k)
        assert model.parameters[own[0] :] == effect.parameter_names
        columns = model.parameter_jacobian(q)
        for i in own:
            # About 1e-4 m of motion; the third derivative leaves its square.
            step = 1e-4 / max(np.abs(columns[:, i]).max(), 1e-3)
            up, down = (model.pose(q, sign * step * np.eye(k)[i]) for sign in (1, -1))
            shift = (up - down)[:3, 3] / (2 * step)
            turn = (up - down)[:3, :3] / (2 * step) @ model.pose(q)[:3, :3].T
            moved = np.array([*shift, turn[2, 1], turn[0, 2], turn[1, 0]])
            np.testing.assert_allclose(columns[:, i], moved, atol=1e-7 * max(1.0, np.abs(moved).max()))


@every_effect
def test_an_effect_without_estimate_is_the_plain_chain(cls: type[Effect], sites: Any) -> None:
    for arm in SHAPES:
        site, robot, inputs = sites[arm]
        for effect in instances(cls, site, robot):
            assert set(effect.values) == {0.0}
            pose = with_effects(robot, (effect,), inputs).pose(site.session.q)
            np.testing.assert_array_equal(pose, po.Arm(robot).pose(site.session.q))


@every_effect
def test_an_effect_survives_its_file(cls: type[Effect], sites: Any) -> None:
    rng = np.random.default_rng(2)
    for arm in SHAPES:
        site, robot, _ = sites[arm]
        for effect in instances(cls, site, robot):
            effect = sized(effect, rng)
            entry = yaml.safe_load(yaml.safe_dump(effect.to_dict()))
            again = read(entry)
            assert type(again) is cls
            assert again.name == effect.name
            assert again.parameter_names == effect.parameter_names
            np.testing.assert_allclose(again.values, effect.values, rtol=1e-11)  # twelve digits in the file
            for name in effect.shape:
                assert getattr(again, name) == pytest.approx(getattr(effect, name), rel=1e-11)
            assert again.to_dict() == entry


@every_effect
def test_a_robot_without_the_target_is_refused(cls: type[Effect], sites: Any) -> None:
    site, robot, _ = sites["seven"]
    effect = instances(cls, site, robot)[0]
    if effect.target in ("all", "base", "payload", "instrument", "linear", "exponential", "settling"):
        effect = instances(cls, site, robot)[-1]
    other = sites["ur10"][1]
    if effect.target in ("base", "tool", "payload", "instrument", "linear", "exponential", "settling"):
        effect.check_robot(other)
    else:
        with pytest.raises(po.errors.BadValueError, match=r"joint1|one of its joints"):
            effect.check_robot(other)


def fitted(effect: Effect, timed: bool = True) -> FittedSizes:
    """Sizes of an effect as a fit reports them, with errors of a tenth."""
    values = {n: (v, abs(v) / 10, "") for (n, _), v in zip(effect.dimensions, effect.values, strict=True)}
    values |= {n: (float(getattr(effect, n)), float(getattr(effect, n)) / 10, "") for n in effect.shape}
    covariance = np.diag([(v / 10) ** 2 for v in effect.values])
    return FittedSizes(values, covariance, timed, (-1e-4, 2e-4))


def one_of_each(sites: Any) -> list[tuple[CatalogueEntry, FittedSizes]]:
    """An instance of every kind of the catalogue with its sizes."""
    site, robot, _ = sites["ur10"]
    moving = [sized(instances(cls, site, robot)[0], np.random.default_rng(4)) for cls in EFFECTS]
    noises = [cls(**NOISE_ENTRIES[cls.kind_name()]) for cls in NOISES]
    pairs = [(effect, fitted(effect)) for effect in moving]
    return [*pairs, *((noise, FittedSizes(NOISE_SIZES[noise.kind])) for noise in noises)]


@every_effect
def test_words_are_whole_and_sizes_have_units(cls: type[Effect], sites: Any) -> None:
    rng = np.random.default_rng(7)
    for arm in SHAPES:
        site, robot, _ = sites[arm]
        for effect in instances(cls, site, robot):
            effect = sized(effect, rng)
            for timed in (True, False):
                sizes = effect.sizes(fitted(effect, timed))
                assert sizes
                assert all(size.label and re.search(r"\d", str(size)) for size in sizes)
                headline = effect.headline(fitted(effect, timed))
                assert not headline or re.search(UNITS, headline), headline
            assert effect.stated_words.startswith(effect.title)
            assert re.search(r"\d", effect.stated_words)


def test_every_cause_has_words_of_its_own(sites: Any) -> None:
    entries = one_of_each(sites)
    assert {type(entry) for entry, _ in entries} == set(CATALOGUE)
    assert len({entry.words for entry, _ in entries}) == len(entries)
    assert len({entry.label for entry, _ in entries}) == len(entries)
    for entry, sizes in entries:
        texts = [entry.words, entry.label, entry.summary, *map(str, entry.sizes(sizes))]
        for text in texts:
            assert "{" not in text
            assert not any(word in text for word in JARGON), text
        assert not entry.words.startswith(entry.kind)
        assert entry.words[-1] != "."
        assert len(entry.words) < 90


def test_every_pair_of_causes_has_a_measurement_that_discriminates_it(sites: Any) -> None:
    entries = [entry for entry, _ in one_of_each(sites)]
    for one, other in product(entries, entries):
        text = one.discrimination(other)
        assert len(text) > 20
        assert "{" not in text
    kinds = {cls.kind_name() for cls in CATALOGUE}
    for entry in entries:
        assert set(entry.rivals) <= kinds - {entry.kind}
        for kind in entry.rivals:  # a pair is told once
            (rival,) = (other for other in entries if other.kind == kind)
            assert entry.kind not in rival.rivals


@every_arm
@every_effect
def test_the_figure_has_an_axis(cls: type[Effect], arm: str, sites: Any) -> None:
    site, robot, inputs = sites[arm]
    state = ArmState(robot, list(site.session.q.T), inputs)
    rows = len(site.session.q)
    for effect, timed in product(instances(cls, site, robot), (True, False)):
        over = effect.abscissa(state, timed)
        if over is None:  # it depends on several things: modelled against measured
            continue
        assert over.values.shape == over.side.shape == (rows,)
        assert np.all(np.isfinite(over.values))
        assert set(np.unique(over.side)) <= {-1.0, 0.0, 1.0}
        assert re.search(r"\[.+\]|row|fraction", over.label), over.label


def test_every_cause_survives_json(sites: Any) -> None:
    for entry, sizes in one_of_each(sites):
        again = read(json.loads(json.dumps(entry.to_dict())))
        assert type(again) is type(entry)
        assert again.to_dict() == entry.to_dict()
        found = json.loads(json.dumps(Finding(entry, sizes.values, 1e-3, 0.1, (entry,)).to_json()))
        assert (found["kind"], found["target"]) == (entry.kind, entry.target)
        assert found["confounded_with"] == [{"kind": entry.kind, "target": entry.target}]


def simulated(cls: type[Effect], sites: Any, folder: Path) -> None:
    """Files with an effect that the simulator does not have: by its own forward model, ten times the noise."""
    site, robot, inputs = sites["ur10"]
    effect = cls.candidates(excitation(site, robot))[0]
    unit = with_effects(robot, (effect.with_estimate([1e-6] * len(effect.dimensions)),), inputs)
    moved = unit.position(site.session.q) - po.Arm(robot).position(site.session.q)
    size = 1e-6 * 10 * SIGMA / np.sqrt(np.mean(moved**2))
    arm = with_effects(robot, (effect.with_estimate([size] * len(effect.dimensions)),), inputs)
    noise = np.random.default_rng(6).normal(0, SIGMA, (len(site.session.q), 3))
    case: Any = SimpleNamespace(
        nominal=site.arm, free=False, word=False, session=site.session, robots=None, priors={}, test=None,
        points=arm.position(site.session.q) + noise, truth={"sigma": SIGMA},
    )  # fmt: skip
    write(case, folder)


def diagnosed(folder: Path) -> po.Diagnosis:
    problem = po.load_problem(folder / "problem.yaml")
    data = po.read_measurements(folder / "data.csv", problem)
    return po.diagnose(problem, data)


def names_of(found: po.Diagnosis) -> set[str]:
    """Kinds that are named, or could stand for what is named."""
    return {cause.kind for f in found.effects for cause in (f.cause, *f.confounded_with)}


@pytest.mark.campaign  # always, for some kinds: tests/diagnosis, tests/hidden
@every_effect
def test_the_search_finds_it_on_simulated_data_and_draws_it(cls: type[Effect], sites: Any, tmp_path: Path) -> None:
    site, robot, _ = sites["ur10"]
    if "speed" in cls.needs:
        pytest.skip("the arm stops at every row here; tests/floor drives it along paths")
    if cls.kind_name() in KINDS:
        write(draw(2026, "full", 0, kind=cls.kind_name(), weakest=STRONG), tmp_path)
    elif cls.candidates(excitation(site, robot)):
        simulated(cls, sites, tmp_path)
    else:
        pytest.skip("no data can show it: the report says so")
    found = diagnosed(tmp_path)
    assert cls.kind_name() in names_of(found)
    assert len(plot_curves(found).axes) >= len(found.fitted_effects) > 0


@pytest.mark.campaign
@pytest.mark.parametrize("kind", sorted({cls.kind_name() for cls in NOISES} & set(FAMILIES)))
def test_the_search_finds_noise_on_simulated_data(kind: str, tmp_path: Path) -> None:
    write(draw(2026, kind, 0, weakest=STRONG), tmp_path)
    assert kind in names_of(diagnosed(tmp_path))
