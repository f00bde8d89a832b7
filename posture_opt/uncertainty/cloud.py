"""``simulate``: the scatter of the tool point by Monte Carlo, through the full forward model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.encoding import encoded
from posture_opt.errors import InputError, Issue
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_SAMPLES
from posture_opt.numerics import Array
from posture_opt.result import Result
from posture_opt.robot.posture import Posture, PostureLike
from posture_opt.statements import Statement, state
from posture_opt.uncertainty.pose_covariance import POSE_FRAME
from posture_opt.uncertainty.regions import NORMAL95, RANK_TOLERANCE, Ellipsoid
from posture_opt.uncertainty.sampler import (
    AdaptiveResult,
    Interval,
    PowerSums,
    Sampler,
    symmetric_matrix,
    variance_intervals,
    wilson_interval,
)
from posture_opt.uncertainty.sampler import adaptive as adaptive_trials
from posture_opt.uncertainty.spread import HasSources, Spread, ellipse_json, propagate, task_json
from posture_opt.uncertainty.task_spread import TaskSpread

_MAX_KEPT_POINTS = 1_000_000  # for figures and files


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(Result):
    """A sample of the tool pose, with the closed form to compare it with.

    The 95 % intervals are those of sampling alone, from the fourth moments of the sample itself, so that they
    hold for a bent, non-Gaussian cloud too.

    Args:
        spread: the closed form at the same posture.
        n: number of samples; ``seed``: of the generator; both reproduce the cloud.
        points: (min(n, 1 000 000), 3) the first tool points [m], world.
        mean: (3,) [m], world.
        covariance: (3, 3) with n − 1 in the denominator [m²], world.
        covariance_of_covariance: (6, 6) of the entries xx, xy, xz, yy, yz, zz [m⁴].
        pose_covariance: (6, 6) of shift [m] and rotation vector [rad] (v, ω) from the nominal pose, world-aligned axes.
        inside: number of samples in the 95 % region of the closed form; ``hits``: within the clearance of the task.
        relative: the same draws relative to a workpiece that errs and is drawn with them; None where none does.
        adaptive: how n was found, in the coordinates of ``spread.basis`` about the nominal point; None where n was
            given.

    Example:
        >>> from posture_opt import load_problem
        >>> cloud = simulate(load_problem("insert_planar_2r"), "90 deg, -90 deg", n=2000)
        >>> cloud.points.shape, 0.93 < cloud.coverage95 < 0.97
        ((2000, 3), True)
    """

    spread: Spread
    n: int
    seed: int
    points: Array
    mean: Array
    covariance: Array
    covariance_of_covariance: Array
    pose_covariance: Array
    inside: int
    hits: int
    relative: Cloud | None = None
    adaptive: AdaptiveResult | None = None

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """How many samples lie where the closed form expects them, and how many do what the task asks."""
        low, high = self.coverage95_interval
        verdict = "agrees" if low <= 0.95 <= high else "less" if self.coverage95 < 0.95 else "more"
        validity = self.spread.validity
        return (
            state("uncertainty.coverage", percent=100 * self.coverage95, samples=self.n),
            state(f"uncertainty.coverage-{verdict}", low=100 * low, high=100 * high),
            *([] if validity.verdict == "good" else [validity.statement]),
            *self._success(),
            *self.spread.limits,
            *self._stability(),
        )

    def _success(self) -> Iterator[Statement]:
        seen, interval = self.spread.for_task, self.success_interval
        if seen is None or interval is None or seen.success_probability is None:
            return
        low, high = interval
        yield from seen.success_statement(self.spread.taught)
        agrees = low - 1e-9 <= seen.success_probability <= high + 1e-9  # rounding
        id = "uncertainty.success-agrees" if agrees else "uncertainty.success-differs"
        yield state(id, hits=self.seen.hits, samples=self.n, low=100 * low, high=100 * high)

    def _stability(self) -> Iterator[Statement]:
        if self.adaptive is not None:
            id = "uncertainty.stable-samples" if self.adaptive.stable else "uncertainty.unstable-samples"
            yield state(id, samples=self.n, digits=self.adaptive.digits)

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the sources come from, joints outside their limits, and whether the sample is stable."""
        return (*self.spread.notes, *(one.text for one in self._stability()))

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m], printed in degrees."""
        return self.spread.posture

    @property
    def seen(self) -> Cloud:
        """The cloud as the task sees it, relative to its workpiece."""
        return self if self.relative is None else self.relative

    @property
    def bias(self) -> Array:
        """(3,) sample mean minus nominal tool point [m]."""
        return self.mean - self.spread.position

    @property
    def bias_error(self) -> Array:
        """(3,) standard error of the mean [m]."""
        return np.asarray(np.sqrt(np.diag(self.covariance) / self.n))

    @property
    def covariance_error(self) -> Array:
        """(3, 3) standard error of each entry of the covariance [m²]."""
        return symmetric_matrix(np.sqrt(np.clip(np.diag(self.covariance_of_covariance), 0, None)))

    @property
    def covariance_interval(self) -> Array:
        """(3, 3, 2) 95 % sampling interval of each entry of the covariance [m²]."""
        half = NORMAL95 * self.covariance_error
        return np.stack([self.covariance - half, self.covariance + half], axis=-1)

    @cached_property
    def ellipse(self) -> Ellipsoid:
        """Of the sample, in the coordinates of ``spread.basis``."""
        return Ellipsoid(self.mean, self.covariance).project(self.spread.basis)

    @property
    def eigenvalues(self) -> Array:
        """(m,) of the sample covariance [m²], ascending."""
        return self.ellipse.semi_axes**2

    @property
    def eigenvalue_intervals(self) -> Array:
        """(m, 2) 95 % sampling intervals [m²].

        Eigenvalues nearer to each other than their intervals repel in every sample; see `variance_intervals`.
        """
        return variance_intervals(
            self.ellipse.axes.T @ self.spread.basis, self.eigenvalues, self.covariance_of_covariance
        )

    @property
    def coverage95(self) -> float:
        """The part of the samples that lies in the 95 % region of the closed form."""
        return self.inside / self.n

    @property
    def coverage95_interval(self) -> Interval:
        """95 % interval of the true coverage (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209)."""
        return wilson_interval(self.inside, self.n)

    @cached_property
    def for_task(self) -> TaskSpread | None:
        """The sample as the task sees it; its probability of success is that of a normal point with these moments."""
        seen, cloud = self.spread.for_task, self.seen
        return None if seen is None else seen.sampled(cloud.covariance, cloud.bias)

    @property
    def success(self) -> float | None:
        """The part of the samples that stays within the clearance; None without a clearance."""
        seen = self.spread.for_task
        return None if seen is None or seen.success_probability is None else self.seen.hits / self.n

    @property
    def success_interval(self) -> Interval | None:
        """95 % interval of the true probability of success (Wilson 1927); None without a clearance."""
        return None if self.success is None else wilson_interval(self.seen.hits, self.n)

    @property
    def ratio(self) -> Array:
        """(m,) standard deviations of the sample over those of the closed form, along the closed form's axes."""
        axes = self.spread.axes
        sampled = np.einsum("mi,ij,mj->m", axes, self.covariance, axes)
        closed = np.einsum("mi,ij,mj->m", axes, self.spread.covariance, axes)
        # Along an axis without variance both are zero, and agree.
        varies = closed > RANK_TOLERANCE * closed[-1]
        return np.asarray(np.sqrt(np.divide(sampled, closed, out=np.ones_like(closed), where=varies)))

    def fields_json(self) -> dict[str, object]:
        """As ``spread.json``, of the sample; budget, first order and validity are those of the model."""
        closed = self.spread.fields_json()
        about = {key: value for key, value in closed.items() if key != "integration"}
        sampled = {
            **encoded(self, "covariance bias pose_covariance"),
            "pose_covariance_frame": POSE_FRAME,
            "pose_covariance_integration": None,
            "ellipse": ellipse_json(self.ellipse, self.spread.basis),
            "method": "Monte Carlo",
            **task_json(self.for_task),
            **encoded(self, "success_probability=success success_probability_interval95=success_interval notes"),
        }
        errors = {
            **encoded(self, "n seed"),
            "adaptive": self.adaptive and encoded(self.adaptive, "stable blocks kp kq"),
            **encoded(self, "mean bias_standard_error=bias_error covariance_standard_error=covariance_error"),
            **encoded(self, "covariance_interval95=covariance_interval eigenvalues"),
            "eigenvalue_intervals95": self.eigenvalue_intervals,
            "coverage95": encoded(self, "value=coverage95 interval95=coverage95_interval"),
        }
        return {**about, **sampled, **errors, "closed_form": closed, "ratio": self.ratio}


@interruptible()
def simulate(
    problem: HasSources, posture: PostureLike, n: int = 5000, seed: int | None = None, adaptive: bool = False,
    digits: int = 2,
) -> Cloud:  # fmt: skip
    """Draw n sets of errors ``p ~ N(0, Σ)`` and send each through the full forward model.

    Samples are drawn in blocks, and at most a million points are kept: memory does not grow with n beyond that.

    Args:
        problem: names ``arm``, ``sources`` and perhaps ``task``.
        posture: n joint values [rad or m], or joint name -> value; numbers, or texts with units.
        n: number of samples; not used with ``adaptive``.
        seed: the same seed gives the same cloud; 0 by default.
        adaptive: draw until means, standard deviations, correlations and coverage factor are stable in ``digits``
            significant digits (JCGM 102:2011, 7.8), at most two million.
        digits: significant digits of the adaptive procedure.

    Returns:
        ``Cloud``: the tool points (n, 3) [m] and their covariance (3, 3) [m²] beside the closed form, world
        frame.

    Raises:
        InputError: no posture, no sources, n < 2 or above 1e8, a negative seed, fewer than one digit.

    Example:
        >>> from posture_opt import load_problem
        >>> cloud = simulate(load_problem("insert_planar_2r"), "90 deg, -90 deg", n=2000, seed=0)
        >>> bool(abs(cloud.ratio - 1).max() < 0.1)
        True
    """
    seed = 0 if seed is None else seed
    _check_arguments(n, seed)
    spread = propagate(problem, posture)
    if not adaptive:
        return cloud_of(spread, n, seed)
    draw = Sampler.of(spread.seen)
    found = adaptive_trials(
        lambda size, rng: draw.both(rng, size)[spread.relative][0] @ spread.basis.T, digits=digits, seed=seed
    )
    # Blocks of another size take the same numbers from the generator, so this is the sample that was found stable.
    cloud = cloud_of(spread, found.n, seed)
    return replace(cloud, adaptive=found)


def cloud_of(spread: Spread, n: int, seed: int) -> Cloud:
    """The cloud about a closed-form spread, drawn in blocks: memory does not grow with n beyond the kept points."""
    rng = np.random.default_rng(seed)
    draw = Sampler.of(spread.seen)
    # Where the workpiece errs, each draw has its poses in the world and relative to it.
    every = [spread] if spread.seen is spread else [spread, spread.seen]
    sums: list[PowerSums] = [PowerSums(one) for one in every]
    kept: list[list[Array]] = [[] for _ in every]
    block = 5_000  # bounds the memory whatever n is
    for start in range(0, n, block):
        poses = draw.both(rng, min(block, n - start))
        for one, total, points in zip(every, sums, kept, strict=True):
            shift, rotation = poses[one.relative]
            total.add(shift, rotation)
            if start < _MAX_KEPT_POINTS:
                points.append(shift[: _MAX_KEPT_POINTS - start] + spread.position)
    found = None
    for one, total, points in reversed(list(zip(every, sums, kept, strict=True))):
        found = _cloud(one, total, np.concatenate(points), n, seed, found)
    assert found is not None
    return found


def _cloud(spread: Spread, sums: PowerSums, points: Array, n: int, seed: int, relative: Cloud | None) -> Cloud:
    offset, covariance = sums.moments(n)
    return Cloud(
        spread=spread,
        n=n,
        seed=seed,
        points=points,
        mean=spread.position + spread.bias + offset[:3],
        covariance=covariance[:3, :3],
        covariance_of_covariance=sums.covariance_of_covariance(n),
        pose_covariance=covariance,
        inside=sums.inside,
        hits=sums.hits,
        relative=relative,
    )


def _check_arguments(n: object, seed: object) -> None:
    issues = []
    if isinstance(n, bool) or not isinstance(n, int | np.integer):
        issues.append(Issue(f"the number of samples is {n!r}", ("n",), n, "give a whole number such as 5000"))
    elif n < 2:
        issues.append(Issue(f"{n} samples have no covariance", ("n",), n, "give 2 or more; 5000 are usual"))
    elif n > MOST_SAMPLES.most:
        issues.append(Issue(MOST_SAMPLES.message(int(n)), ("n",), n, MOST_SAMPLES.hint))
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        issues.append(Issue(f"the seed is {seed!r}", ("seed",), seed, "give a whole number of 0 or more"))
    if issues:
        raise InputError(issues)
