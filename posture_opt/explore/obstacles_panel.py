"""``ObstaclesPanel``: obstacles of the cell added, moved, resized and removed."""

from __future__ import annotations

import copy
import math
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.collision.obstacles import OBSTACLES
from posture_opt.collision.obstacles.obstacle import Obstacle
from posture_opt.explore.drawing import on_user
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.problem.schema import nodes_at
from posture_opt.problem.yaml_source import Plain, Section

if TYPE_CHECKING:
    import viser

_NONE = "none"
# Dimension -> units of the page in one SI unit, their name, and digits.
_SHOWN = {"length": (1e3, "mm", 1), "angle": (180.0 / math.pi, "deg", 2)}


@dataclass(frozen=True)
class _Entry:
    """One key of an obstacle that holds a length or an angle, or three of them."""

    key: str
    value: Any
    scale: float
    unit: str
    digits: int

    def shown(self) -> Any:
        """Its value in the units of the page."""
        found = np.round(self.scale * np.asarray(self.value, dtype=float), self.digits)
        return tuple(found.tolist()) if found.ndim else float(found)

    def written(self, shown: Any) -> Plain:
        """A value in the units of the page, as files write it."""
        words = [f"{v:.{self.digits}f} {self.unit}" for v in np.atleast_1d(shown)]
        return words if isinstance(self.value, tuple) else words[0]


class ObstaclesPanel:
    """The controls of the obstacles.

    Args:
        chosen: called with the place (3,) [m] of the obstacle that was chosen; None for none, or one without a place.
        near: (3,) where a new obstacle is put [m], world.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        problem: Problem,
        changed: Callable[[dict[str, Plain]], bool],
        chosen: Callable[[Array | None], None],
        near: Callable[[], Array],
    ) -> None:
        self._gui, self._changed, self._chosen, self._near = gui, changed, chosen, near
        cell = problem.document.get("cell")
        self._off = isinstance(cell, str)  # `cell: none` asks for no checks
        self._problem = problem
        self._entries: list[Section] = [] if self._off else copy.deepcopy(list((cell or {}).get("obstacles") or ()))
        self._which: Any = gui.add_dropdown("Obstacle", (_NONE, *self._names()), hint="a handle moves the chosen one")
        self._sizes = gui.add_folder("Size and place", visible=False)
        self._fields: dict[str, tuple[_Entry, Any]] = {}
        drawn = [kind for kind in OBSTACLES if "file" not in kind.model_fields]  # a part from CAD needs its file
        kinds = {typing.get_args(kind.model_fields["kind"].annotation)[0]: kind for kind in drawn}
        kind: Any = gui.add_dropdown("Kind", tuple(kinds), disabled=self._off)
        add = gui.add_button("Add an obstacle", disabled=self._off)
        remove = gui.add_button("Remove the chosen one", disabled=self._off)
        on_user(self._which, self._choose)
        add.on_click(lambda _: self._add(kind.value, kinds[kind.value]))
        remove.on_click(lambda _: self._remove())

    def move(self, place: Array) -> None:
        """The chosen obstacle was dragged to a place (3,) [m]."""
        if "xyz" in self._fields:
            entry, field = self._fields["xyz"]
            field.value = tuple(float(v) for v in np.round(entry.scale * place, entry.digits))
            self._put(entry, field.value)

    def _names(self) -> list[str]:
        return [str(entry["name"]) for entry in self._entries]

    def _choose(self) -> None:
        for _, field in self._fields.values():
            field.remove()
        self._fields = {}
        there = self._which.value in self._names()
        self._sizes.visible = there
        place = None
        if there:
            with self._sizes:
                for entry in _entries(self._problem, self._names().index(self._which.value)):
                    self._fields[entry.key] = entry, self._field(entry)
                    place = np.array(entry.value) if entry.key == "xyz" else place
        self._chosen(place)

    def _field(self, entry: _Entry) -> Any:
        label, step = f"{entry.key} [{entry.unit}]", 10.0**-entry.digits
        made = self._gui.add_vector3 if isinstance(entry.value, tuple) else self._gui.add_number
        field: Any = made(label, entry.shown(), step=step)

        def typed() -> None:
            self._put(entry, field.value)
            if entry.key == "xyz":
                self._chosen(np.array(field.value) / entry.scale)

        on_user(field, typed)
        return field

    def _put(self, entry: _Entry, shown: Any) -> None:
        if self._which.value not in self._names():  # another browser has removed it meanwhile
            return
        entries = copy.deepcopy(self._entries)
        entries[self._names().index(self._which.value)][entry.key] = entry.written(shown)
        self._send(entries)

    def _send(self, entries: list[Section]) -> bool:
        """Ask for other obstacles; what does not fit changes nothing."""
        fit = self._changed({"cell__obstacles": entries})
        self._entries = entries if fit else self._entries
        return fit

    def _add(self, word: str, kind: type[Obstacle]) -> None:
        names = self._names()
        name = next(name for k in range(1, len(names) + 2) if (name := f"{word} {k}") not in names)
        new: Section = {"name": name, "kind": word}
        for key, field in kind.model_fields.items():
            if field.is_required() and key not in new:
                new[key] = ["150 mm"] * 3 if typing.get_origin(field.annotation) is tuple else "150 mm"
        if "xyz" in kind.model_fields:
            new["xyz"] = [f"{1e3 * v:.1f} mm" for v in self._near()]
        if self._send([*copy.deepcopy(self._entries), new]):
            self._list(name)

    def _remove(self) -> None:
        kept = [entry for entry in self._entries if entry["name"] != self._which.value]
        if len(kept) < len(self._entries) and self._send(kept):
            self._list(_NONE)

    def _list(self, chosen: str) -> None:
        self._which.options = (_NONE, *self._names())
        self._which.value = chosen
        self._choose()

    def follow(self, problem: Problem) -> None:
        """The problem as it is now: what the fields show."""
        self._problem = problem


def _entries(problem: Problem, number: int) -> Iterator[_Entry]:
    """The lengths and angles of an obstacle, by their dimension in the schema."""
    assert problem.cell is not None
    obstacle: Obstacle = problem.cell.obstacles[number]
    document = problem.to_dict()
    document["cell"]["obstacles"][number] |= {"xyz": [0, 0, 0], "rpy": [0, 0, 0]}
    for key in type(obstacle).model_fields:
        value = getattr(obstacle, key)
        place = ("cell", "obstacles", number, key, *((0,) if isinstance(value, tuple) else ()))
        dimension = next((node["dimension"] for node in nodes_at(place, document) if "dimension" in node), None)
        if dimension in _SHOWN:
            yield _Entry(key, value, *_SHOWN[dimension])
