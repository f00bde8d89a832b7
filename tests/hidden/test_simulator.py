"""The simulator that hides effects, held against Pinocchio, against itself, and against what it hands over."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from tests.helpers.variants import conformance
from tests.hidden.arms import ARMS
from tests.hidden.designs import Plan, draw_session
from tests.hidden.draw import draw, geometry, place
from tests.hidden.effects import FORMS, Effect, Site, measured
from tests.hidden.families import FAMILIES, Setting
from tests.hidden.files import write
from tests.hidden.mechanics import columns, moment, torques, walk
from tests.hidden.noise import Noise, lever
from tests.hidden.rivals import candidates
from tests.hidden.strength import basis, names_of, off, reference_rms, signature, strain, strength, tangent

HERE = Path(__file__).parent
FREE_OF_THE_PACKAGE = sorted(set(HERE.glob("*.py")) - {HERE / "hunt.py"} - set(HERE.glob("test_*.py")))


def site_of(arm: str, seed: int = 3, rows: int = 150, **more: object) -> Site:
    rng = np.random.default_rng(seed)
    placed = place(rng, ARMS[arm]())
    session = draw_session(rng, placed, Plan(rows=rows, logged=True, **more))
    return Site(placed, session, geometry(rng, placed, Setting(arm)))


@pytest.mark.parametrize("path", FREE_OF_THE_PACKAGE, ids=lambda p: p.name)
def test_the_simulator_knows_nothing_of_the_package(path: Path) -> None:
    assert len(FREE_OF_THE_PACKAGE) > 10
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for name in names:
            assert not name.startswith("posture_opt"), f"{path.name}:{node.lineno}"
            assert not name.startswith("tests.helpers"), f"{path.name}:{node.lineno}"
            # Nor does it read the harness, which does know the package.
            assert name != "tests.hidden.hunt"


@pytest.fixture(scope="module")
def seven() -> tuple[Site, pinocchio.Model]:
    site = site_of("seven")
    model = pinocchio.buildModelFromXML(site.arm.urdf)
    return Site(site.arm, site.session, {}), model


def test_the_seven_joint_arm_stands_where_pinocchio_says(seven: tuple[Site, pinocchio.Model]) -> None:
    site, model = seven
    data = model.createData()
    T_world_base, T_flange_tool = (_frame([f.value for f in part]) for part in (site.arm.base, site.arm.tool))
    for q, p in zip(site.session.q, site.walk.p, strict=True):
        pinocchio.framesForwardKinematics(model, data, q)
        T = T_world_base * data.oMf[model.getFrameId("link7")] * T_flange_tool
        np.testing.assert_allclose(p, T.translation, atol=1e-12)  # sums of a few metres in double precision


def _frame(values: list[float]) -> pinocchio.SE3:
    x, y, z, yaw, pitch, roll = values
    return pinocchio.SE3(pinocchio.rpy.rpyToMatrix(roll, pitch, yaw), np.array([x, y, z]))


def test_gravity_torques_are_pinocchios(seven: tuple[Site, pinocchio.Model]) -> None:
    site, model = seven
    T_world_base = _frame([f.value for f in site.arm.base])
    tool = np.array([f.value for f in site.arm.tool[:3]])
    for q, load, tau in zip(site.session.q, site.session.payload, site.tau, strict=True):
        loaded = model.copy()
        loaded.gravity.linear = T_world_base.rotation.T @ site.arm.gravity
        loaded.appendBodyToJoint(7, pinocchio.Inertia(load, tool, np.zeros((3, 3))), pinocchio.SE3.Identity())
        # What holds the arm is the negative of what gravity does to it. Some 100 N m, double precision.
        np.testing.assert_allclose(tau, -pinocchio.computeGeneralizedGravity(loaded, loaded.createData(), q), atol=1e-9)


@pytest.mark.parametrize("arm", conformance(sorted(ARMS), ["seven", "scara"]))
def test_torque_is_the_work_of_gravity(arm: str) -> None:
    """Virtual work: τ_j = −∂V/∂q_j with V = −Σ m g·c, by differences."""
    site = site_of(arm, rows=35)
    load, step = site.session.payload, 1e-6

    def energy(q: np.ndarray) -> np.ndarray:
        w = walk(site.arm, q, site.deviations)
        centres = w.o_link + np.einsum("njab,jb->nja", w.R_link, site.arm.coms)
        return -np.einsum("nja,a,j->n", centres, site.arm.gravity, site.arm.masses) - load * (w.p @ site.arm.gravity)

    for j in range(site.arm.n):
        dq = step * np.eye(site.arm.n)[j]
        work = -(energy(site.session.q + dq) - energy(site.session.q - dq)) / (2 * step)
        # Differences of energies of 1 kJ lose half the digits: 1e3 · 1e-16 / 1e-6.
        np.testing.assert_allclose(site.tau[:, j], work, atol=5e-6)


@pytest.mark.parametrize("arm", conformance(sorted(ARMS), ["seven", "scara"]))
def test_the_tangent_is_the_derivative(arm: str) -> None:
    site = site_of(arm, rows=35)
    found, step = columns(site.walk, site.arm), 1e-6
    for name in names_of(site, True):
        up, down = (
            walk(site.arm, site.session.q, {**site.deviations, name: site.deviations.get(name, 0.0) + s}).p
            for s in (step, -step)
        )
        np.testing.assert_allclose(found[name], (up - down) / (2 * step), atol=1e-8)
    for j in range(site.arm.n):
        e = step * np.eye(site.arm.n)[j]
        turned = (walk(site.arm, site.session.q + e, site.deviations).p - site.walk.p) / step
        np.testing.assert_allclose(lever(site, j), turned, atol=1e-5)


def test_bending_of_the_last_bending_link_is_a_beams() -> None:
    """Planar arm: the tip turns by φ = κ M about the end of link 1 and is shifted by φ × L / 2."""
    site = site_of("planar", rows=35)
    e = Effect("link_bending", "joint1", {"k": 1e-7})
    w = site.walk
    M = moment(site.arm, w, site.session.payload, w.o_link[:, 0], 1)
    np.testing.assert_allclose(M[:, :2], 0, atol=1e-12)
    phi = 1e-7 * M
    expected = np.cross(phi, w.p - w.o_link[:, 0]) + np.cross(phi, w.o_link[:, 0] - w.o[:, 0]) / 2
    # second order in angles of 1e-5
    np.testing.assert_allclose(measured(site, (e,)) - w.p, expected, atol=1e-9)
    # All of the second arm hangs on joint 2, which the moment about the end of link 1 turns as a torque would.
    np.testing.assert_allclose(M[:, 2], torques(site.arm, w, site.session.payload)[:, 1], atol=1e-9)


@pytest.mark.parametrize("arm", conformance(["ur10", "planar", "seven"], ["ur10"]))
def test_every_effect_is_linear_in_its_size_and_zero_without(arm: str) -> None:
    site = site_of(arm, rows=35)
    kinds = set()
    for e in candidates(site):
        kinds.add(e.kind)
        full, half = (measured(site, (e.scaled(100 * s),)) - site.walk.p for s in (1.0, 0.5))
        assert np.abs(measured(site, (e.scaled(0.0),)) - site.walk.p).max() < 1e-12
        np.testing.assert_allclose(half, full / 2, atol=5e-7)  # second order in errors of up to 3e-4 rad
    assert len(kinds) >= 13
    assert kinds <= set(FORMS)


def test_a_gauge_parameter_adds_nothing_and_an_effect_within_it_is_worth_nothing() -> None:
    site = site_of("ur10")
    U = basis(tangent(site, names_of(site, True), 5e-5))
    assert 25 <= U.shape[1] <= 28  # 6R arm with free frames, position only
    # A scale of the instrument is a longer arm farther away.
    assert strength(site, Effect("instrument_scale", "instrument", {"c": 1e-5}), U, 5e-5) < 1e-6
    assert strength(site, Effect("joint_scale", "joint3", {"c": 3e-4}), U, 5e-5) > 100


def test_noncentrality_is_the_expected_growth_of_chi_squared() -> None:
    site = site_of("ur10")
    U = basis(tangent(site, names_of(site, True), 5e-5))
    e = Effect("gear_eccentricity", "joint2", {"a": 5e-5, "b": 0.0})
    z = signature(site, (e,), 5e-5)
    rng = np.random.default_rng(0)
    draws = [np.sum(off(U, z + n) ** 2) - np.sum(off(U, n) ** 2) for n in rng.normal(size=(400, len(z)))]
    expected = strength(site, e, U, 5e-5)
    assert abs(np.mean(draws) - expected) < 4 * np.std(draws) / 20  # of 400 draws
    assert reference_rms(site, np.zeros((150, 3)), U) < 1e-12


def test_noise_is_as_stated() -> None:
    site = site_of("ur10", rows=3000, repeated=0)
    rng = np.random.default_rng(1)
    for noise in (Noise(), Noise(freedom=4.0), Noise(factor=2.0), Noise(a=1e-5, b=2e-5)):
        added, _ = noise.draw(rng, site)
        ratio = (added / noise.sigma(site.walk.p)[:, None]).std()
        assert ratio == pytest.approx(1.0, abs=0.05)  # 9000 values; Student's t has a heavy fourth moment
    added, rows = Noise(gross=3, gross_size=1e-3).draw(rng, site)
    assert set(np.argsort(np.linalg.norm(added, axis=1))[-3:]) == set(rows)


@pytest.mark.parametrize("family", conformance(sorted(FAMILIES), ["batch", "joint_noise", "planar"]))
def test_a_seed_is_a_case(family: str) -> None:
    first, again, other = draw(5, family), draw(5, family), draw(6, family)
    np.testing.assert_array_equal(first.points, again.points)
    assert first.truth["effects"] == again.truth["effects"]
    assert first.points.shape != other.points.shape or np.abs(first.points - other.points).max() > 0
    for e in first.truth["effects"]:
        # A loose effect was of that strength before it was loosened.
        assert e["lambda"] >= (12.0 if family == "loose" else 24.9) or e["kind"] == "instrument_scale"


@pytest.mark.parametrize(
    "family", conformance(["full", "scara", "seven", "planar", "batch", "kr16"], ["full", "seven", "batch"])
)
def test_the_files_are_read_by_the_package_as_they_were_meant(family: str, tmp_path: Path) -> None:
    import posture_opt as po
    from posture_opt.measurements.measurements import nominal_poses

    case = draw(2, family, kind="drift" if family not in ("batch",) else "", test=family == "full")
    problem = po.load_problem(write(case, tmp_path))
    data = po.read_measurements(tmp_path / "data.csv", problem)
    np.testing.assert_allclose(data.q, case.session.q, atol=1e-10)
    k = list(case.nominal.measured)
    np.testing.assert_allclose(data.position[:, k], case.points[:, k], atol=1e-8)
    # The nominal arm of the file is the simulator's, to the digits of the joint values.
    place_of_file = nominal_poses(problem.robot, data.q)[0]
    nominal = walk(case.nominal, case.session.q).p
    if not case.word:
        np.testing.assert_allclose(place_of_file, nominal, atol=1e-9)
    np.testing.assert_allclose([j.mass for j in problem.robot.joints], case.nominal.masses)
    if case.session.sides_stated:
        np.testing.assert_array_equal(data.approach, np.sign(case.session.side))
    elif case.robots is None:
        np.testing.assert_array_equal(data.approach[1:], case.session.side[1:])
        np.testing.assert_allclose(data.approach_length[1:], case.session.travel[1:], atol=1e-9)
    if case.session.logged:
        np.testing.assert_allclose(data.temperature, case.session.temperature, atol=6e-3)
    words = (tmp_path / "problem.yaml").read_text() + (tmp_path / "data.csv").read_text()[:400]
    assert not any(str(e["kind"]) in words for e in case.truth["effects"])
    assert (tmp_path / "test.csv").exists() == (family == "full")


def test_many_parameters_need_more_strength() -> None:
    from scipy.special import chdtri, chndtr

    quadratic = Effect("instrument_field", "instrument", {str(i): 0.0 for i in range(18)})
    line, level = chdtri(1, 4.65e-4), 4.65e-4
    assert 1 - chndtr(line, 1, 25.0) == pytest.approx(0.933, abs=0.002)
    assert 1 - chndtr(chdtri(18, level), 18, 25.0 * strain(quadratic)) == pytest.approx(0.933, abs=0.01)
