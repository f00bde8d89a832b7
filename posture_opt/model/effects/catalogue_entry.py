"""``CatalogueEntry``: what all kinds of the catalogue have in common, whether they move the tool point or spread it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import WithJsonSchema

from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec

Input = str  # "approach", "payload", "temperature", "time", "masses", "gear_ratio"
Quantity = Annotated[Any, WithJsonSchema({"type": ["string", "number"]})]


@dataclass(frozen=True)
class Limit:
    """A cause that cannot be known from data of a kind, why, and what would tell."""

    kind: str
    target: str
    reason: str
    mend: str

    def to_json(self) -> dict[str, str]:
        """The entry of ``unknowable`` in ``diagnosis.json``."""
        return {"kind": self.kind, "target": self.target, "reason": self.reason, "mend": self.mend}


@dataclass(frozen=True)
class Evidence:
    """What one robot's data are made of.

    Args:
        positions: whether an instrument measured places, in place of touched points.
        lengths: names of the arm's lengths that the data could tell something about.
    """

    positions: bool
    lengths: tuple[str, ...]


class CatalogueEntry(Spec):
    """One kind of the catalogue at one target."""

    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""
    shape_units: ClassVar[Mapping[str, str]] = {}
    """SI units of the fields that have one."""
    needs: ClassVar[frozenset[Input]] = frozenset()
    """Inputs without which the effect cannot be seen."""

    kind: str

    @property
    @abstractmethod
    def target(self) -> str:
        """What the effect is of: a joint, a length, base, tool, payload, instrument or data."""

    @property
    def name(self) -> str:
        """``kind(target)``."""
        return f"{self.kind}({self.target})"

    def robot_fault(self, robot: Robot) -> str:
        """What this robot lacks for the effect, or an empty text."""
        return ""

    @classmethod
    def unknowable(cls, evidence: Evidence) -> Limit | None:
        """Why no data of this kind can ever show the effect, whatever its size; ``None`` where they can."""
        return None

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``effects:`` in a problem file."""
        entry = {key: value for key, value in self.model_dump(exclude_none=True).items() if value not in ({}, ())}
        for name, unit in self.shape_units.items():
            if name in entry:
                entry[name] = f"{entry[name]:.12g} {unit}"
        return {key: list(value) if isinstance(value, tuple) else value for key, value in entry.items()}
