"""Covariances of many postures: the numbers of one posture, its speed, memory and messages."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.factors import random_postures
from tests.helpers.moments import correlated, errors_of, planar
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import Sources, stated
from tests.helpers.variants import conformance, find_compiler, needs_compiler


def problem(name, angle=0.05, length=0.01, kinds=("theta", "a", "d"), coupled=False):
    robot = preset_robot(name)
    sources = errors_of(robot, angle, length, kinds)
    return stated(robot=robot, sources=correlated(sources) if coupled else sources)


CASES = [(name, False) for name in ("scara", "ur10", "panda")] + [("planar_2r", True), ("scara", True), ("ur5", True)]


ALWAYS = [("scara", False), ("planar_2r", True), ("ur5", True)]


@pytest.mark.parametrize(
    ("name", "coupled", "compiled"),
    conformance(
        [(*case, compiled) for case in CASES for compiled in (False, True) if not compiled or find_compiler()],
        [*((*case, False) for case in ALWAYS), *([("scara", False, True)] if find_compiler() else [])],
    ),
)
def test_it_gives_what_propagate_gives(name, coupled, compiled):
    given = problem(name, coupled=coupled, kinds=("theta",) if name == "ur5" and coupled else ("theta", "a", "d"))
    spread_at = po.SpreadFunction(given, compiled=compiled)
    assert spread_at.compiled is compiled
    Q = random_postures(given.robot, 4)
    found = spread_at(Q), spread_at.first_order(Q), spread_at.position(Q), spread_at.mean(Q)
    for row, q in enumerate(Q):
        spread = po.propagate(given, q)
        assert spread_at.method == spread.method
        expected = spread.covariance, spread.first_order, spread.position, spread.position + spread.bias
        for values, value in zip(found, expected, strict=True):
            # hundreds of operations on metres of order one; variances of order 0.01. Correlated errors in space have
            # nodes that are good at most, not all, postures: three times what was found at some of them.
            near = 1e-14 + 3 * spread_at.relative_error * np.trace(spread.covariance)
            np.testing.assert_allclose(values[row], value, rtol=1e-7, atol=near)
            assert spread_at.relative_error < 1e-3


@needs_compiler
def test_blocks_do_not_show():
    given = problem("ur5")
    spread_at = po.SpreadFunction(given)
    Q = random_postures(given.robot, 200_003)
    found = spread_at(Q)
    assert found.shape == (200_003, 3, 3)
    for row in (0, 99_999, 100_000, 199_999, 200_002):
        np.testing.assert_array_equal(found[row], spread_at(Q[row]))
    np.testing.assert_array_equal(found, np.swapaxes(found, 1, 2))


@needs_compiler
def test_memory_is_linear_in_the_postures():
    given = problem("ur5")
    spread_at = po.SpreadFunction(given)
    spread_at(random_postures(given.robot, 10))
    peaks = {}
    for n in (100_000, 400_000):
        Q = random_postures(given.robot, n)
        tracemalloc.start()
        spread_at(Q)
        peaks[n] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # the result is 72 bytes a posture; beside it stand two blocks of upper triangles and the test of finiteness
    assert peaks[400_000] < 400_000 * (72 + 6 + 8) + 2_000_000
    assert peaks[400_000] < 4.5 * peaks[100_000]


def test_postures_are_read_strictly():
    spread_at = po.SpreadFunction(planar(), compiled=False)
    for Q, words in (
        ([0.1], "postures of shape (1,)"),
        (np.zeros((5, 3)), "postures of shape (5, 3)"),
        (np.zeros((2, 5, 2)), "postures of shape (2, 5, 2)"),
        ([[0, 0], [0, np.nan]], "the posture in row 1 is not finite"),
        (["a", "b"], "no array of numbers"),
        (0.5, "postures of shape ()"),
    ):
        with pytest.raises(po.errors.InputError) as caught:
            spread_at(Q)
        assert words in str(caught.value)
        assert "joint1, joint2" in str(caught.value)


def test_nothing_uncertain_is_refused_and_no_variance_is_zero():
    robot = preset_robot("planar_2r")
    with pytest.raises(po.errors.InputError, match="nothing is uncertain"):
        po.SpreadFunction(stated(robot=robot, sources=Sources()))
    still = po.SpreadFunction(stated(robot=robot, sources=Sources(("joint1.a",), np.zeros((1, 1)))), compiled=False)
    np.testing.assert_array_equal(still([[0.1, 0.2]]), np.zeros((1, 3, 3)))
    np.testing.assert_array_equal(still.first_order([[0.1, 0.2]]), np.zeros((1, 3, 3)))


def along_any_direction(C, reference):
    """Largest relative difference of the variance along any direction."""
    values, axes = np.linalg.eigh(reference)
    W = axes / np.sqrt(values)
    return np.abs(np.linalg.eigvalsh(W.T @ (C - reference) @ W)).max()


@pytest.mark.long
def test_the_stated_error_is_that_of_large_correlated_errors():
    """Four factors, which `propagate` integrates to 1e-8; none of the postures is one that the error was taken at."""
    given = problem("ur5", angle=np.radians(10), kinds=("theta",))
    given = stated(robot=given.robot, sources=correlated(given.sources, seed=2))
    spread_at = po.SpreadFunction(given, compiled=False)
    Q = np.random.default_rng(3).uniform(given.robot.lower, given.robot.upper, (12, 6))
    off = max(along_any_direction(C, po.propagate(given, q).covariance) for C, q in zip(spread_at(Q), Q, strict=True))
    assert off < 0.01
    assert off / 3 < spread_at.relative_error < 3 * off


def test_few_or_no_postures_of_many_nodes():
    given = problem("ur5", angle=np.radians(10), kinds=("theta",), coupled=True)
    spread_at = po.SpreadFunction(given, compiled=False)
    Q = random_postures(given.robot, 90)
    whole, mean = spread_at(Q), spread_at.mean(Q)
    assert spread_at(Q[:0]).shape == (0, 3, 3)
    np.testing.assert_allclose(spread_at(Q[89]), whole[89], rtol=1e-12)
    np.testing.assert_allclose(spread_at.mean(Q[89]), mean[89], rtol=1e-12)
    np.testing.assert_array_equal(whole, np.swapaxes(whole, 1, 2))
    assert (np.linalg.eigvalsh(whole) > 0).all()
