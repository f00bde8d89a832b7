"""Residuals of an arm against measurements and their derivatives, all rows at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter, effect_parameters, tool_unknown
from posture_opt.measurements.kinds import Seen
from posture_opt.measurements.kinds.kind import Slots
from posture_opt.measurements.measurements import Measurements, arm_for
from posture_opt.model.arm import Arm, Reached, Twist
from posture_opt.model.chain import Walk, dot, factor_values, walk
from posture_opt.numerics import Array, Codes, rms, stacked_rows
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:
    from posture_opt.model.effects import Effect
    from posture_opt.model.effects.base.effect import Sensitivity

MAX_WALKED_ROWS = 20_000
"""Rows that are walked at a time where nothing but their errors is asked for: the chain holds some hundred arrays."""
Distance = tuple[int, int, float, float]
"""Codes of two points, their distance [m] and its standard deviation [m]."""


_POSTURES_OF_SHIFTS, _SAME_DIRECTION = 4, 1e-9
"""Random postures in which a direction is compared, and how far it may differ: rounding."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Model minus measurement as a function of the deviations ``x`` (k,) of ``parameters`` from nominal [rad, m].

    Row i has the residuals ``(h(T(q_i; x)) − m_i) / σ`` [1], h what the `Kind` of measurement shows of the pose T: of
    positions the measured axes of the world, of poses the orientation behind them; known distances follow behind all
    rows. All rows are walked at once: a call costs a few hundred array operations, whatever N.
    """

    arm: Arm  # under the inputs of every row of ``data``, see `Residuals.of`
    data: Measurements
    parameters: tuple[Parameter, ...]
    sigma: float  # standard deviation of each measured coordinate [m]
    # σ of what is read beside that, by its key, as of the components of a measured rotation [rad]; what has none does
    # not count
    further: Mapping[str, float] = field(default_factory=dict)
    # (first point, second point, distance [m], standard deviation [m]) known between points
    distances: tuple[Distance, ...] = ()
    # standard deviations of a reading at some places, as planes of another flatness
    place_sigmas: Mapping[str, float] = field(default_factory=dict)
    # root mean square of the levers of the rows that ``sigma`` is of [m per unit]; 1 of readings in metres
    lever: float = 1.0

    @classmethod
    def of(
        cls, arm: Arm, data: Measurements, parameters: tuple[Parameter, ...], sigma: float,
        further: Mapping[str, float] | None = None, distances: tuple[Distance, ...] = (),
        place_sigmas: Mapping[str, float] | None = None,
    ) -> Residuals:  # fmt: skip
        """Of an arm whose effects see the inputs of every row."""
        own, data = dict(place_sigmas or {}), counted(data, further or {})
        others = {one.key: (further or {})[one.key] for one in data.kind.further}
        lever = 1.0 if data.lever is None else rms(data.lever)
        return cls(arm_for(arm.for_fit(), data), data, parameters, sigma, others, distances, own, lever)

    @property
    def robot(self) -> Robot:
        """The arm without its effects."""
        return self.arm.robot

    @cached_property
    def axes(self) -> Codes:
        """Which numbers of a reading errors count in: of positions, and poses, the measured coordinates."""
        return self.data.kind.axes(self.data.measured_axes)

    @cached_property
    def slots(self) -> tuple[tuple[int, Any], ...]:
        """Numbers of a reading that count, `axes` first, and the σ of each in its unit, (N,) where rows differ."""
        further = {slot: self.further[one.key] for one in self.data.kind.further for slot in one.slots}
        numbers = self.data.kind.numbers(self.data.measured_axes).tolist()
        return tuple((slot, further.get(slot, self._unit_sigma)) for slot in numbers)

    @property
    def block(self) -> int:
        """The number of residuals of one row."""
        return len(self.slots)

    @property
    def free_groups(self) -> frozenset[str]:
        """The groups of parameters that are fitted to the nominal arm too: places and free frames."""
        free = {"place": True, "base": self.robot.base_free, "tool": tool_unknown(self.robot, self.data)}
        return frozenset(group for group, is_free in free.items() if is_free)

    @property
    def free(self) -> Codes:
        """(f,) the parameters of those groups."""
        return np.array([i for i, p in enumerate(self.parameters) if p.group in self.free_groups], dtype=np.intp)

    @property
    def measured(self) -> int:
        """The number of residuals of all rows; those of known distances come behind them."""
        return len(self.data) * self.block

    @cached_property
    def q(self) -> list[Array]:
        """(n,) of the commanded joints (N,) [rad or m]."""
        return [np.ascontiguousarray(column) for column in self.data.q.T]

    def of_data(self, data: Measurements, distances: tuple[Distance, ...] = ()) -> Residuals:
        """Arm and parameters against other measurements."""
        data = counted(data, self.further)
        return replace(self, arm=arm_for(self.arm, data), data=data, distances=distances)

    def of_robot(self, robot: Robot, parameters: tuple[Parameter, ...]) -> Residuals:
        """Measurements against a robot with other frames or nominal values."""
        return replace(self, arm=replace(self.arm, robot=robot), parameters=parameters)

    def with_effects(self, effects: Sequence[Effect], x: Array) -> Residuals:
        """Add the parameters of effects and their smooth shapes as unknowns, zero effects at zero deviations."""
        known = {effect.name for effect in self.arm.effects}
        new = [e.with_estimate([0.0] * len(e.dimensions)) for e in effects if e.name not in known]
        robot = replace(self.robot, gravity=gravity_of(self.robot, self.frames(x)))
        parameters = [p for effect in effects for p in effect_parameters(effect)]
        arm = replace(self.arm, robot=robot, effects=(*self.arm.effects, *new))
        return replace(self, arm=arm, parameters=(*self.parameters, *parameters))

    def with_parameters(self, parameters: Sequence[Parameter]) -> Residuals:
        """Keep some of the parameters, and the effects that still do something."""
        sources = {p.source for p in parameters}
        effects = tuple(e for e in self.arm.effects if sources & set(e.parameter_names) or any(e.values))
        return replace(self, arm=replace(self.arm, effects=effects), parameters=tuple(parameters))

    def start_of(self, effects: Sequence[Effect]) -> Array:
        """(e,) where the fit of effects starts: at their shapes and estimates; with nothing of one without estimate."""
        places = self.arm.shape_parameters
        found: list[float] = []
        for effect in effects:
            found += effect.values
            if effect.smooth_shape:
                own = self.arm.effects[places[f"{effect.name}.{effect.smooth_shape}"]]
                found.append(effect.shape_deviation(own))
        return np.array(found)

    def fitted_effects(self, effects: Sequence[Effect], x: Array) -> tuple[Effect, ...]:
        """The effects with the estimates and shapes that the last of the deviations ``x`` (k,) say."""
        at = {p.name: float(v) for p, v in zip(self.parameters, x, strict=True)}
        places, fitted = self.arm.shape_parameters, list[Any]()
        for effect in effects:
            shape, sizes = f"{effect.name}.{effect.smooth_shape}", [at[name] for name in effect.parameter_names]
            if shape in places:
                own = self.arm.effects[places[shape]].reshaped(at[shape])
                effect = effect.with_shape(float(getattr(own, own.smooth_shape)))
            fitted.append(effect.with_estimate(sizes))
        return tuple(fitted)

    def frames(self, x: Array) -> dict[str, float]:
        """Deviations of base and tool; of several targets, none of the tool."""
        frames = [
            (p.name, v) for p, v in zip(self.parameters, x, strict=False) if p.group in ("base", "tool") and p.code < 0
        ]
        return {name: float(v) for name, v in frames}

    def take(self, rows: Codes) -> Residuals:
        """The residuals of some rows."""
        return replace(self, arm=self.arm.under(self.arm.inputs.take(rows)), data=self.data.take(rows))

    def deviations(self, x: Array) -> dict[str, Any]:
        """Model parameter -> deviation, of some targets' offsets one for each row (N,)."""
        values: dict[str, Any] = {}
        for parameter, deviation in zip(self.parameters, x, strict=True):
            if parameter.source and parameter.code < 0:
                values[parameter.source] = float(deviation)
            elif parameter.source:
                rows = values.setdefault(parameter.source, np.zeros(len(self.data)))
                rows[self.data.target == parameter.code] = deviation
        return values

    def walk(self, x: Array) -> Walk:
        """The chain at all rows with the deviations ``x`` (k,) [rad, m]: origins [m] and axes of all factors, world."""
        return self.arm.reach(self.q, self.deviations(x)).walk

    def sensitivities(
        self, names: Sequence[str | int], x: Array, reached: Walk | None = None, ones: Sequence[Sensitivity] = ()
    ) -> Array:
        """(N, block, K) shift of what a row measures by a unit of each model parameter, in units of the σ's."""
        reached = reached or self.walk(x)
        twists = self.arm.twists(names, self.q, reached, self.deviations(x), ones)
        return self.whiten(twists, x, reached)

    def reading_shifts(self, names: Sequence[str | int], x: Array) -> list[Array]:
        """For each model parameter, (N, 3) the change of what is read by a unit of it [m/rad or m/m], as `error`."""
        reached = self.walk(x)
        twists, seen = self.arm.twists(names, self.q, reached, self.deviations(x)), self.seen(x, reached)
        return [self._rows(self.data.kind.slope(seen, shift, turn)) for shift, turn in twists]

    def _rows(self, slots: Slots) -> Array:
        """(N, 3) [m] of the numbers of a reading that errors count in; zeros behind them."""
        rows = stacked_rows([*slots[:3], *[0.0] * (3 - len(slots))], len(self.data))
        return rows if self.data.lever is None else rows * self.data.lever[:, None]

    def whiten(self, twists: Sequence[Twist], x: Array, reached: Walk) -> Array:
        """(N, block, K) of K shifts and small rotations of the tool at deviations ``x`` (k,), in units of the σ's."""
        found = np.empty((len(self.data), self.block, len(twists)))
        kind, seen = self.data.kind, self.seen(x, reached)
        for k, (shift, turn) in enumerate(twists):
            changed = kind.slope(seen, shift, turn)
            for place, (slot, sigma) in enumerate(self.slots):
                found[:, place, k] = changed[slot] / sigma
        return found

    def error(self, x: Array, reached: Walk | None = None) -> Array:
        """Reading of the model minus the measured one (N, 3) [m], in the coordinates `axes`; zeros in others."""
        if reached is None and len(self.data) > MAX_WALKED_ROWS:
            parts = np.array_split(np.arange(len(self.data)), -(-len(self.data) // MAX_WALKED_ROWS))
            return np.concatenate([self.take(rows).error(x) for rows in parts])
        return self._rows(self.data.kind.error(self.seen(x, reached or self.walk(x))))

    def seen(self, x: Array, reached: Walk) -> Seen:
        """The rows beside where the arm has the tool at the deviations ``x``."""
        return self.data.seen(reached.position, reached.columns, self.places(x))

    def places(self, x: Array) -> Array:
        """(P, u) what is unknown of places among the deviations ``x``: coordinates of touched points [m], planes, …"""
        found = np.zeros((len(self.data.place_names) or 1, self.data.kind.width))
        for parameter, value in zip(self.parameters, x, strict=True):
            if not parameter.source and parameter.code >= 0:
                found[parameter.code, parameter.axis] = parameter.nominal + value
        return found

    @cached_property
    def row_sigma(self) -> Any:
        """Standard deviation of a reading [m], (N,) where it is not the same in all rows."""
        return self._unit_sigma if self.data.lever is None else self._unit_sigma * self.data.lever

    @property
    def _unit_sigma(self) -> Any:
        """Standard deviation of a reading in the unit of the kind, (N,) where it is not the same in all rows."""
        if not self.place_sigmas:
            return self.sigma / self.lever
        names, own = self.data.weighed
        return np.array([self.place_sigmas.get(name, self.sigma) for name in names])[own]

    def metres(self, whitened: Array, rows: Codes | slice = slice(None)) -> Array:
        """What values (n, …) of some rows, in units of the σ's, are in [m]."""
        if not self.place_sigmas and self.data.lever is None:
            return whitened * self.sigma
        sigma = self.row_sigma[rows]
        return np.asarray(whitened * sigma.reshape(-1, *[1] * (whitened.ndim - 1)))

    def further_error(self, x: Array) -> Array:
        """(N, d) reading of the model minus the measured one in what is read beside `axes`: of poses, the rotation."""
        found = self.data.kind.error(self.seen(x, self.walk(x)))
        return stacked_rows([found[slot] for slot, _ in self.slots[len(self.axes) :]], len(self.data))

    def whitened(self, x: Array) -> Array:
        """Residuals (N·block + distances,) in units of the instrument's σ."""
        return self._vector(x, self.walk(x))

    def residuals_and_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Whitened residuals (m,) and their Jacobian (m, k)."""
        reached = self.arm.reach(self.q, self.deviations(x))
        return self._vector(x, reached.walk), self._jacobian(x, reached)

    def _vector(self, x: Array, reached: Walk) -> Array:
        """Whitened residuals (m,) of rows, then of known distances."""
        off = self.data.kind.error(self.seen(x, reached))
        rows = stacked_rows([off[slot] / sigma for slot, sigma in self.slots], len(self.data)).ravel() / self._size(x)
        return np.concatenate([rows, self._distance_residuals(x)[0]])

    def _jacobian(self, x: Array, reached: Reached) -> Array:
        """Derivatives (m, k) of the whitened residuals; a parameter of one target or point acts in its rows alone."""
        J = np.zeros((len(self.parameters), len(self.data), self.block))
        own, seen = [k for k, p in enumerate(self.parameters) if p.source], self.seen(x, reached.walk)
        columns = self.sensitivities([self.parameters[k].source for k in own], x, reached.walk, reached.ones)
        J[own] = np.moveaxis(columns, -1, 0)
        for k, parameter in enumerate(self.parameters):
            if parameter.source:
                if parameter.code >= 0:
                    J[k, self.data.target != parameter.code] = 0.0
                continue
            changed, mine = self.data.kind.unknown_slope(seen, parameter.axis), self.data.at_place(parameter.code)
            for place, (slot, sigma) in enumerate(self.slots):
                J[k, mine, place] = np.broadcast_to(changed[slot] / sigma, mine.shape)[mine]
        dense = J.reshape(len(self.parameters), -1).T
        if self._sizes.any():
            rows = self._vector(x, reached.walk)[: len(dense), None]
            dense = (dense - rows * self._sizes) / self._size(x)
        return np.concatenate([dense, self._distance_residuals(x)[1]]) if self.distances else dense

    @cached_property
    def _sizes(self) -> Array:
        """(k,) growth of the arm by a unit of each parameter; zeros where the data know its size, or are angles.

        Errors count relative to the size where they show none: an arm of half the size misses its planes by half, and a
        fit would shrink it. Of the lengths L the growth by deviations x is ``L·x / |L|²``. What only shifts the places
        or the tool is no part of it: it would be without bounds, and make every error small.
        """
        if self.data.kind.fixes_size or self._touched_distances or self.data.lever is not None:
            return np.zeros(len(self.parameters))
        shifts = lengths_that_shift(self.robot, tool_free="tool" in self.free_groups)
        L = np.array([p.nominal * (p.made and p.unit == "m" and p.name not in shifts) for p in self.parameters])
        return L / float(L @ L) if L.any() else L

    def _size(self, x: Array) -> float:
        """The size of the arm at the deviations x (k,), relative to nominal."""
        return 1.0 + float(self._sizes @ x)

    @cached_property
    def _touched_distances(self) -> list[int]:
        ends = [(a, b) for a, b, *_ in self.distances]
        return [i for i, pair in enumerate(ends) if all(self.data.at_place(end).any() for end in pair)]

    def distance_errors(self, x: Array) -> Array:
        """(d,) known distances between touched points at the deviations x (k,), less what is stated, in their σ's."""
        return self._distance_residuals(x)[0]

    def _distance_residuals(self, x: Array) -> tuple[Array, Array]:
        """Whitened residuals (d,) of known distances between touched points, and their derivatives (d, k)."""
        r, J = np.zeros(len(self.distances)), np.zeros((len(self.distances), len(self.parameters)))
        points = self.places(x)[:, :3] if self.distances else np.zeros((0, 3))
        for row in self._touched_distances:
            a, b, length, sigma = self.distances[row]
            between = points[a] - points[b]
            reached = max(float(np.linalg.norm(between)), 1e-12)
            r[row] = (reached - length) / sigma
            for k, parameter in enumerate(self.parameters):
                if parameter.group == "place" and parameter.code in (a, b):
                    J[row, k] = (1 if parameter.code == a else -1) * between[parameter.axis] / reached / sigma
        return r, J


def lengths_that_shift(robot: Robot, *, tool_free: bool) -> frozenset[str]:
    """The lengths of an arm that shift all that it reaches, whatever the posture: a column's height, say."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (robot.n, _POSTURES_OF_SHIFTS))
    reached = walk(robot.factors, factor_values(robot.factors, list(q)))

    def constant(axis: Sequence[Any]) -> bool:
        return all(np.ptp(np.atleast_1d(entry)) < _SAME_DIRECTION for entry in axis)

    found = set()
    for factor, screw in zip(robot.factors, reached.screws, strict=True):
        in_tool = [dot(column, screw.axis) for column in reached.columns]
        if constant(screw.axis) or (tool_free and constant(in_tool)):
            found.add(factor.parameter)
    return frozenset(found)


def counted(data: Measurements, further: Mapping[str, float]) -> Measurements:
    """The measurements without what has no σ: orientations, unless ``further`` states theirs."""
    return data if all(one.key in further for one in data.kind.further) else data.without_orientation()


def gravity_of(robot: Robot, frames: Mapping[str, float]) -> tuple[float, float, float]:
    """Gravity [m/s²] in the world of the data, with the base off by ``frames`` from the file's."""
    g = np.array(robot.gravity)
    if not robot.base_free or float(np.linalg.norm(g)) == 0.0:
        return robot.gravity
    found, stated = (walk(robot.base, factor_values(robot.base, [], off)).columns for off in (frames, {}))
    turn = np.array(found, dtype=float).T @ np.array(stated, dtype=float)
    # Upright in the instrument's frame but for 10°, the instrument was levelled and the tilt is the base's own; else
    # the arm is mounted as the file says, and the instrument is not level.
    x, y, z = g if float(g @ turn @ g) / float(g @ g) > np.cos(np.radians(10)) else turn @ g
    return float(x), float(y), float(z)
