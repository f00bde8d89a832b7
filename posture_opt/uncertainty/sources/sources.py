"""``Sources``: which model parameters are uncertain, by how much, and how they are correlated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.numerics import Array

_MAX_SIGMA = 1e5
"""Standard deviation [m or rad] beyond which a unit or an exponent is wrong."""
_EIGENVALUE_ROUNDING = 1e-9
"""Of an eigenvalue of a correlation matrix, per row: what float arithmetic leaves of a zero."""


@dataclass(frozen=True, eq=False)
class Sources:
    """Named Gaussian errors of model parameters with mean zero and one covariance matrix.

    Args:
        names: (k,) names of model parameters, ``JOINT.PARAMETER``.
        covariance: (k, k), SI units: rad², m², rad m.
        notes: sentences for the report on where the numbers come from.
        scatter: (k, k) the part of the covariance that is drawn anew at every repeat; the rest is what is not known of
            errors that stay. Where it is left out, no part.
        details: those of the notes that a report of one screen leaves out.
        assumed: whether nothing was stated, so that the repeatability of the data sheet stands for it.

    Example:
        >>> Sources.independent({"joint1.theta": 0.01, "joint1.a": 1e-4}).sigma.tolist()
        [0.01, 0.0001]
    """

    names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    notes: tuple[str, ...] = ()
    scatter: Array = field(default_factory=lambda: np.zeros((0, 0)))
    details: tuple[str, ...] = ()
    assumed: bool = False

    def __post_init__(self) -> None:
        """Makes both matrices read-only arrays of the right size."""
        size = (len(self.names),) * 2
        for name in ("covariance", "scatter"):
            matrix = np.array(getattr(self, name), dtype=float)
            if name == "scatter" and not matrix.size:
                matrix = np.zeros(size)
            assert matrix.shape == size, "the covariance has a row for each name"
            matrix.setflags(write=False)
            object.__setattr__(self, name, matrix)

    @classmethod
    def independent(cls, sigma: Mapping[str, float], notes: Sequence[str] = ()) -> Sources:
        """Sources without correlation from standard deviations [rad or m]."""
        return cls(tuple(sigma), np.diag(np.square(list(sigma.values()))), tuple(notes))

    @classmethod
    def scattering(cls, sigma: Mapping[str, float], notes: Sequence[str] = ()) -> Sources:
        """Sources without correlation that are drawn anew at every repeat, from standard deviations [rad or m]."""
        found = cls.independent(sigma, notes)
        return cls(found.names, found.covariance, found.notes, found.covariance)

    @property
    def constant(self) -> Array:
        """(k, k) covariance of what is not known of the errors that stay from repeat to repeat."""
        return self.covariance - self.scatter

    @property
    def sigma(self) -> Array:
        """(k,) standard deviations [rad or m]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlated(self) -> bool:
        """Whether any two sources vary together."""
        return bool(np.any(self.covariance[~np.eye(len(self.names), dtype=bool)]))

    @property
    def empty(self) -> bool:
        """Whether nothing is uncertain."""
        return not self.names

    def same_as(self, other: Sources) -> bool:
        """Whether both state the same errors."""
        mine, theirs = ((one.covariance, one.scatter) for one in (self, other))
        return self.names == other.names and all(map(np.array_equal, mine, theirs))

    def without(self, names: Sequence[str]) -> Sources:
        """The sources but for some names, with their covariance and scatter."""
        kept = [k for k, name in enumerate(self.names) if name not in names]
        at = np.ix_(kept, kept)
        names = tuple(self.names[k] for k in kept)
        return replace(self, names=names, covariance=self.covariance[at], scatter=self.scatter[at])

    def joined(self, other: Sources) -> Sources:
        """Both sets of sources, the two independent of each other.

        Raises:
            InputError: a name that is in both.
        """
        twice = sorted(set(self.names) & set(other.names))
        if twice:
            raise InputError(Issue(f"the error of {', '.join(twice)} is stated twice", hint="state it once"))
        return self.plus(other)

    def plus(self, other: Sources) -> Sources:
        """The sum of both errors, independent of each other: covariances add up where both name a parameter."""
        names = tuple(dict.fromkeys((*self.names, *other.names)))
        covariance, scatter = np.zeros((2, len(names), len(names)))
        for part in (self, other):
            at = np.ix_(*[[names.index(name) for name in part.names]] * 2)
            covariance[at] += part.covariance
            scatter[at] += part.scatter
        notes, details = (*self.notes, *other.notes), (*self.details, *other.details)
        return Sources(names, covariance, notes, scatter, details, self.assumed or other.assumed)


def covariance_issues(names: Sequence[str], covariance: Array) -> list[Issue]:
    """What keeps a symmetric matrix from being a covariance: negative variances or impossible correlations.

    A matrix is a covariance exactly if it is positive semidefinite. The test is made on the matrix of
    correlations, which has no units: in the covariance itself a few rad² would drown in m², or the reverse.
    """
    variance = np.diag(covariance)
    negative = [name for name, v in zip(names, variance, strict=True) if v < 0]
    if negative:
        return [Issue(f"negative variance of {', '.join(negative)}", hint="a variance is 0 or greater")]
    sigma = np.sqrt(variance)
    far = [f"{name} is {s:.4g}" for name, s in zip(names, sigma, strict=True) if s > _MAX_SIGMA]
    if far:
        return [Issue(f"not plausible: the σ of {', '.join(far)}", hint="in m or rad; are unit and exponent right?")]
    idle = sigma == 0
    for i, j in np.argwhere((covariance != 0) & idle[:, None]):
        return [Issue(f"{names[i]} has variance 0 but covaries with {names[j]}", hint="state its variance")]
    correlation = covariance[~idle][:, ~idle] / np.outer(sigma[~idle], sigma[~idle])
    beyond = np.argwhere(np.triu(np.abs(correlation) > 1 + _EIGENVALUE_ROUNDING, 1))
    varying = [name for name, still in zip(names, idle, strict=True) if not still]
    if len(beyond):
        return [_correlation_issue(varying[i], varying[j], correlation[i, j]) for i, j in beyond]
    return _definiteness_issues(varying, correlation)


def _correlation_issue(a: str, b: str, rho: float) -> Issue:
    """The issue about a correlation beyond ±1."""
    return Issue(f"the correlation of {a} and {b} is {rho:.6g}", hint="a correlation lies between -1 and 1")


def _definiteness_issues(names: Sequence[str], correlation: Array) -> list[Issue]:
    """The issue about a matrix of correlations (k, k) with a negative eigenvalue, and the sources that cause it."""
    if not len(names):
        return []
    values, vectors = np.linalg.eigh(correlation)
    if values[0] >= -_EIGENVALUE_ROUNDING * len(names):
        return []
    # The eigenvector says which combination of errors would have a negative variance.
    weights = np.abs(vectors[:, 0])
    involved = [name for name, w in zip(names, weights, strict=True) if w > 0.1 * weights.max()]
    message = (
        f"not positive semidefinite: the correlations of {', '.join(involved)} contradict each other "
        f"(smallest eigenvalue of the correlation matrix {values[0]:.4g})"
    )
    return [Issue(message, hint="no random errors have such correlations; make them smaller until it is 0 or greater")]
