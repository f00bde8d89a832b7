"""``CatalogueEntry``: what all kinds of the catalogue have in common, whether they move the tool point or spread it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import WithJsonSchema

from posture_opt.model.effects.base.cause import Cause
from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec

Input = str
"""A key of ``INPUTS``."""
Quantity = Annotated[Any, WithJsonSchema({"type": ["string", "number"]})]
"""A number for a ratio, else a text with a unit; read where the dimension of the parameter is known."""


@dataclass(frozen=True)
class NeededInput:
    """What an effect may need to be seen.

    Args:
        words: its name in reports.
        hint: how to supply it.
    """

    words: str
    hint: str


INPUTS: dict[Input, NeededInput] = {
    "approach": NeededInput(
        "both sides", "approach each joint value from both sides; columns 'JOINT.approach' state them"
    ),
    "payload": NeededInput("payload", "measure with two payloads or more, in a column 'payload [kg]'"),
    "temperature": NeededInput("temperature", "log it as it changes, in a column 'temperature [degC]'"),
    "time": NeededInput("time", "log it in a column 'time [s]'"),
    "speed": NeededInput("motion", "measure along a moving path and log the time of its rows in a column 'time [s]'"),
    "masses": NeededInput("masses", "state 'mass' and 'com' of every joint in the problem file"),
    "gear_ratio": NeededInput("gear ratio", "state 'gear_ratio' of every joint in the problem file"),
}
"""Key of an input -> its name and how to supply it."""


@dataclass(frozen=True)
class Limit:
    """A cause that cannot be known from data of a kind.

    Args:
        kind, target: of the cause.
        reason: why not.
        hint: what would show it.
    """

    kind: str
    target: str
    reason: str
    hint: str

    def to_json(self) -> dict[str, str]:
        """The entry of ``unknowable`` in ``diagnosis.json``."""
        return {"kind": self.kind, "target": self.target, "reason": self.reason, "hint": self.hint, "mend": self.hint}


@dataclass(frozen=True)
class Evidence:
    """What one robot's data are made of.

    Args:
        positions: whether an instrument measured lengths, in place of touched points and planes.
        lengths: names of the arm's lengths that the data could say something about.
    """

    positions: bool
    lengths: tuple[str, ...]


class CatalogueEntry(Cause, Spec):
    """One kind of the catalogue at one target: an entry of ``effects:`` in a problem file."""

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

    @property
    def stated_words(self) -> str:
        """Kind, target and stated size: "joint compliance of elbow 8.00 µrad/(N m) (stiffness 125 kN m/rad)"."""
        named = f"{self.title} of {self.place}" if self.place else self.title
        qualifier = f", {self.qualifier}" if self.qualifier else ""
        return f"{named} {self.stated_size}{qualifier}"

    @property
    @abstractmethod
    def stated_size(self) -> str:
        """The size that the entry states, with its unit."""

    def planning_note(self, kept: bool) -> str:
        """Whether a task is planned with it and why not; empty where it simply is.

        Args:
            kept: whether the file asks for it although it changes with time.
        """
        return ""

    @classmethod
    def kind_name(cls) -> str:
        """The ``kind`` of every instance."""
        return str(cls.model_fields["kind"].default)

    def check_robot(self, robot: Robot) -> None:
        """Refuse a robot that lacks what the effect is about.

        Raises:
            BadValueError: no such joint or length, or one of another type.
        """

    @classmethod
    def unknowable(cls, evidence: Evidence) -> Limit | None:
        """Why no data of this kind can ever show the effect, whatever its size; ``None`` where they can."""
        return None

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``effects:`` in a problem file, with units; empty and absent fields are left out."""
        entry = {key: value for key, value in self.model_dump(exclude_none=True).items() if value not in ({}, ())}
        for name, unit in self.shape_units.items():
            if name in entry:
                entry[name] = f"{entry[name]:.12g} {unit}"
        return {key: list(value) if isinstance(value, tuple) else value for key, value in entry.items()}
