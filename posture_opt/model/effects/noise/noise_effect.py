"""``NoiseEffect``: what spreads measurements, or the tool point itself, and leaves their mean where it is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from posture_opt.model.effects.base.cause import CatalogueEntry
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot
from posture_opt.units import shown


@dataclass(frozen=True, eq=False)
class Rows:
    """What the covariance of measured rows may depend on."""

    robot: Robot  # whose joints they are
    levers: Array  # (n, N, d) shift of the measured coordinates per unit of each joint, in units of sigma
    ranges: Array | None  # (N,) distance of the measured points from the instrument [m]; None where none is known
    sigma: float  # the instrument's σ of a coordinate as stated [m]
    # (N,) which rows were measured at one visit, so that they share the joints' scatter; None if each row is a visit of
    # its own
    visits: Codes | None = None
    turned: int = 0  # how many of the d coordinates, the last ones, are of the orientation


class Pattern(ABC):
    """How one kind of noise would spread the rows, for every size of it on a grid: ``Σ_i = s² exp(l_i) (I + (k_i − 1)
    u_i u_iᵀ)``, s² common to all rows and unknown. Where more than one direction is spread alike, u_i are its ``rank``
    columns."""

    effect: type[NoiseEffect]
    target: str
    grid: Array
    quantity: tuple[str, str]  # Name and SI unit of its size
    # (N, d) the directions u_i; None where all directions spread alike, or where they are no single ones
    unit: Array | None = None
    rank: int = 1  # How many directions of a row u_i spans

    def along(self, sets: Array) -> Array | None:
        """(F, N) squared parts of residuals (F, N, d) along u_i; ``None`` where all directions spread alike."""
        return None if self.unit is None else np.asarray(np.einsum("fnd,nd->fn", sets, self.unit) ** 2)

    def inflation(self, value: float) -> Array:
        """(N,) k_i: variance along u_i over that across it; 1 where no direction is another than the rest."""
        return np.ones(1)

    def level(self, value: float) -> Array | None:
        """(N,) l_i: logarithm of the variance over s²; ``None`` for none."""
        return None

    def units(self, value: float) -> Array | None:
        """(d,) σ of each coordinate of all rows in units of s, where it only says that units are wrong; else None."""
        return None

    @abstractmethod
    def size(self, value: float, s2: float) -> float:
        """The size [SI] at a value of the grid with the s² that belongs to it."""

    def strength(self, value: float, s2: float) -> float:
        """What the same noise has in common in samples of other rows: the size, unless that is of these rows."""
        return self.size(value, s2)

    @abstractmethod
    def error(self, value: float, s2: float) -> float:
        """The standard error [SI] of that size, by Fisher's information; infinite for none."""

    @abstractmethod
    def named(self, value: float, s2: float, std: float) -> NoiseEffect:
        """The effect of that size, with its standard error."""


class NoiseEffect(CatalogueEntry):
    """One kind of effect that changes a covariance and no mean.

    What is of the arm spreads the tool point: it adds to the scatter from repeat to repeat, or correlates what is not
    known of the geometry. What is of the instrument or of the data changes how far measurements are believed.
    """

    of_arm: ClassVar[bool] = False  # Whether it spreads the tool point; else it is of the measurement alone
    uneven: ClassVar[bool] = False  # Whether it spreads some measurements more than others
    of_stated: ClassVar[bool] = False  # Whether it changes an instrument's σ that has to be stated
    # Its words where the file states no scatter of that target at all, if they differ: {target}, {size}
    unstated: ClassVar[str] = ""

    # What errors look like that repeats do not show to be this noise
    uneven_words: ClassVar[str] = (
        "Errors are larger where {target} moves the tool more, as if it stopped elsewhere each time"
    )

    @property
    def changed_sigma(self) -> str:
        """Which σ of the instrument it changes, if `of_stated`: ``position`` or ``orientation``."""
        return "position"

    @property
    def uneven_clause(self) -> str:
        return self.uneven_words.format(target=self.target)

    @property
    @abstractmethod
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        """Name, value [SI] and dimension of what says how large it is."""

    @property
    def stated_size(self) -> str:
        return f"({', '.join(f'{name} {shown(value, dimension)}' for name, value, dimension in self.stated)})"

    def scatter(self, robot: Robot) -> dict[str, float]:
        """Model parameter -> σ that is added to its scatter from repeat to repeat [rad or m]."""
        return {}

    @property
    def correlation(self) -> tuple[tuple[str, str, float], ...]:
        """Pairs of model parameters whose stated errors are correlated, with the coefficient."""
        return ()

    def reading(self, sigma: Array, ranges: Array) -> Array:
        """(N,) the instrument's σ of a coordinate [m] at these distances. sigma: (N,) without the effect [m]; ranges:
        (N,) from the instrument [m]."""
        return sigma

    def turning(self, sigma: float) -> float:
        """The instrument's σ of a rotation [rad], where without the effect it is ``sigma``."""
        return sigma

    def shape(self, rows: Rows) -> Array | None:
        """(N, d, d) covariance of the rows in units of ``rows.sigma``², up to a factor; ``None`` if one."""
        return None

    @property
    def usable(self) -> float:
        """The share of measurements that are left to learn from, 0 to 1."""
        return 1.0

    def joined(self, other: NoiseEffect) -> NoiseEffect:
        """One effect of the same kind and target that does what both do together."""
        return other

    @classmethod
    def patterns(cls, rows: Rows) -> Sequence[Pattern]:
        """Every way in which an effect of this kind could spread these rows unevenly."""
        return ()
