"""Each named effect as a curve with the errors behind it, and what is left of the errors over every joint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.report.effect_words import short_words
from posture_opt.report.figures.residual_joints import Binned
from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION, legend_below, new_figure, styled

if TYPE_CHECKING:
    from posture_opt.calibration.effect_sensitivities import EffectSensitivities
    from posture_opt.diagnosis.causes import Finding
    from posture_opt.report.diagnosed import Diagnosed

Floats = NDArray[np.float64]

_MOST = 12  # effects
_DOTS = 800
_MANY = 300  # rows: then dots are small
_BINS = 24
_FEWEST = 4  # rows of a bin
_LEVER = 0.1  # of the longest: nearer to its axis, a joint moves the tool point in no direction to speak of
_SIDES = {-1.0: ORANGE, 1.0: PURPLE}  # rows without a side are blue


@dataclass(frozen=True, eq=False)
class Curve:
    """What is drawn of one effect.

    Args:
        x: (n,) what it hangs on; ``side`` (n,) the side of approach where there are two curves, else 1.
        errors: (n,) what the rest of the model leaves of the errors, along the effect; ``modelled`` (n,) the effect.
    """

    x: Floats
    side: Floats
    errors: Floats
    modelled: Floats
    xlabel: str
    ylabel: str


@styled
def plot_curves(diagnosed: Diagnosed) -> Figure:
    """The modelled effect, and what the data say of it once everything else is taken off."""
    from posture_opt.calibration.effect_sensitivities import EffectSensitivities

    tangents = EffectSensitivities(diagnosed.residuals, diagnosed.diagnosis.model.x)
    shown = diagnosed.effects[:_MOST]
    columns = min(len(shown), 2)
    rows = math.ceil(len(shown) / columns)
    figure = new_figure(9.6 if columns == 2 else 7.2, 0.8 + 2.9 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (place, finding) in zip(grid, shown, strict=False):
        _panel(axes, curve_of(diagnosed, tangents, place, finding))
        axes.set_title(short_words(finding.kind, finding.target, finding.estimate))
    for axes in grid[len(shown) :]:
        axes.set_visible(False)
    handles: dict[str, Any] = {}
    for axes in grid[: len(shown)]:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3, markerscale=1.5)
    return figure


def _panel(axes: Any, curve: Curve) -> None:
    dots = chosen_rows(len(curve.x), _DOTS)
    sides = np.unique(curve.side[curve.side != 0])  # where nobody knows the side, neither curve is meant
    look = _look(len(curve.x))
    for side in sides:
        mine = curve.side == side
        colour, name = (BLUE, "rows") if len(sides) < 2 else (_SIDES.get(side, GREY), f"side {side:+.0f}")
        some = dots[mine[dots]]
        axes.plot(curve.x[some], curve.errors[some], ".", color=colour, label=name, **look)
        last = side == sides[-1]
        if mine.sum() > _FEWEST:
            label = "mean of neighbours with its 95 % band" if last else ""
            Binned.of(curve.x[mine], curve.errors[mine], _BINS).draw(axes, "black", label)
        order = np.argsort(curve.x[mine])
        label = "modelled effect" if last else ""
        axes.plot(curve.x[mine][order], curve.modelled[mine][order], color=VERMILLION, lw=2, zorder=3.5, label=label)
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    low, high = np.quantile(curve.errors, [0.01, 0.99])
    low, high = min(low, curve.modelled.min(), 0.0), max(high, curve.modelled.max(), 0.0)
    margin = 0.07 * max(high - low, 1e-9)
    left, right = np.quantile(curve.x, [0.002, 0.998])
    pad = 0.04 * max(right - left, 1e-9)
    axes.set(xlim=(left - pad, right + pad), ylim=(low - margin, high + margin))
    axes.set(xlabel=curve.xlabel, ylabel=curve.ylabel)


def _look(rows: int) -> dict[str, Any]:
    """Of dots: the more there are, the smaller."""
    size = {"ms": 3, "alpha": 0.35} if rows > _MANY else {"ms": 6, "alpha": 0.5}
    return {"mew": 0, "rasterized": True, **size}


def curve_of(diagnosed: Diagnosed, tangents: EffectSensitivities, place: int, finding: Finding) -> Curve:
    """The curve of one effect: over what it hangs on where that is one number, else as modelled against as seen."""
    model, residuals = diagnosed.diagnosis.model, diagnosed.residuals
    shape = (len(residuals.data), residuals.block)
    effect = (model.suspects[place].Z @ model.theta[model.slices[place]]).reshape(shape)
    partial = effect - model.whitened().reshape(shape)
    moved = {j for move in model.suspects[place].what.moves(tangents.site) for j in move.joints}  # type: ignore[union-attr]
    over = _hangs_on(finding, tangents, place, diagnosed) if len(moved) == 1 else None
    if over is not None:
        joint = next(iter(moved))
        column = tangents.joints[joint]
        square = np.sum(column**2, axis=1)
        far = square > (_LEVER**2) * square.max()
        factor, unit = (1e3, "mrad") if residuals.robot.joints[joint].type == "revolute" else (1e6, "µm")
        x, side, xlabel = over
        errors, modelled = (factor * np.sum(e * column, axis=1)[far] / square[far] for e in (partial, effect))
        return Curve(x[far], side[far], errors, modelled, xlabel, f"error of the joint [{unit}]")
    axes = slice(0, len(residuals.axes))
    e, m = (1e3 * residuals.sigma * v[:, axes] for v in (partial, effect))
    one = np.ones(len(e))
    if finding.kind in ("drift", "slip"):
        mean = m.mean(axis=0)
        along = mean / max(float(np.linalg.norm(mean)), 1e-300)
        x, label = _time(tangents)
        return Curve(x, one, e @ along, m @ along, label, "error along the shift [mm]")
    size = np.linalg.norm(m, axis=1)
    some = size > _LEVER * size.max()
    along = m[some] / size[some][:, None]
    errors = np.sum(e[some] * along, axis=1)
    return Curve(size[some], one[some], errors, size[some], "modelled effect at the tool [mm]", "seen along it [mm]")


def _hangs_on(
    finding: Finding, tangents: EffectSensitivities, place: int, diagnosed: Diagnosed
) -> tuple[Floats, Floats, str] | None:
    """What a joint's effect is a curve of, with the side of approach where it has two, and its name."""
    effect: Any = diagnosed.diagnosis.model.suspects[place].what
    data, site = diagnosed.residuals.data, tangents.site
    n = len(data)
    one = np.ones(n)
    names = list(data.joint_names)
    if finding.kind == "slip":
        x, label = _time(tangents)
        return x, one, label
    if finding.kind == "joint_coupling":
        return _joint(diagnosed, names.index(effect.follows), one)
    joint = names.index(effect.joint)
    q, side = data.q[:, joint], np.sign(data.approach[:, joint])
    if finding.kind in ("joint_scale", "gear_eccentricity", "gear_second_harmonic"):
        return _joint(diagnosed, joint, one)
    if finding.kind in ("cyclic_error", "gear_ripple"):
        k = effect.cycles if finding.kind == "cyclic_error" else effect.harmonic * effect.ratio
        return np.degrees(np.mod(k * q, 2 * np.pi)), one, f"phase of the cycle [deg], {k:.4g} cycles a turn"
    if finding.kind == "quantisation":
        return np.mod(q / effect.lsb, 1.0), one, "part of a step"
    if finding.kind == "backlash":
        x, _, label = _joint(diagnosed, joint, one)
        return x, side, f"{label}, by the side it came from"
    if finding.kind == "hysteresis":
        return side * np.degrees(data.approach_length[:, joint]), one, f"last move of {effect.joint} [deg]"
    if finding.kind == "thermal_offset":
        return np.broadcast_to(np.asarray(site.inputs.temperature, dtype=float), (n,)), one, "temperature above 20 degC"
    if finding.kind in ("joint_compliance", "load_backlash") and getattr(effect, "loads", "masses") == "masses":
        torque = np.broadcast_to(np.asarray(site.torque(joint), dtype=float), (n,))
        if finding.kind == "load_backlash":
            return side * np.abs(torque), one, f"torque on {effect.joint} [N m], with the sign of the side"
        return torque, one, f"torque of gravity on {effect.joint} [N m]"
    return None


def _joint(diagnosed: Diagnosed, joint: int, one: Floats) -> tuple[Floats, Floats, str]:
    data, kind = diagnosed.residuals.data, diagnosed.residuals.robot.joints[joint]
    factor, unit = (math.degrees(1.0), "deg") if kind.type == "revolute" else (1e3, "mm")
    return factor * data.q[:, joint], one, f"{kind.name} [{unit}]"


def _time(tangents: EffectSensitivities) -> tuple[Floats, str]:
    """When each row was measured, in minutes; the number of the row where no times are logged."""
    data = tangents.residuals.data
    time = np.broadcast_to(np.asarray(tangents.site.inputs.time, dtype=float), (len(data),))
    return (time + 1.0, "row, in the order of measuring") if data.time is None else (time / 60, "time [min]")


@styled
def plot_left(diagnosed: Diagnosed) -> Figure:
    """What the model with its effects leaves, along the motion of each joint and over the rows."""
    from posture_opt.calibration.effect_sensitivities import EffectSensitivities

    residuals = diagnosed.residuals
    tangents = EffectSensitivities(residuals, diagnosed.diagnosis.model.x)
    e = -diagnosed.diagnosis.model.whitened().reshape(len(residuals.data), residuals.block)
    moving = [k for k in range(residuals.robot.n) if np.ptp(residuals.data.q[:, k]) > 1e-6]
    rows = math.ceil((len(moving) + 1) / 2)
    figure = new_figure(9.6, 0.8 + 2.0 * rows)
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    for axes, joint in zip(grid, moving, strict=False):
        column = tangents.joints[joint]
        lever = np.linalg.norm(column, axis=1)
        far = lever > _LEVER * lever.max()
        along = 1e3 * residuals.sigma * np.sum(e * column, axis=1)[far] / lever[far]
        x, _, label = _joint(diagnosed, joint, np.ones(len(e)))
        _cloud(axes, x[far], along, label)
    axes = grid[len(moving)]
    lengths = 1e3 * residuals.sigma * np.linalg.norm(e[:, : len(residuals.axes)], axis=1)
    rows_by_time = np.arange(1, len(e) + 1, dtype=np.float64)
    _cloud(axes, rows_by_time, lengths, "row, in the order of measuring (length of the error)")
    high = float(np.quantile(lengths, 0.99))
    for panel in grid[: len(moving)]:
        panel.set_ylim(-high, high)
    axes.set_ylim(0, 1.2 * high)
    for spare in grid[len(moving) + 1 :]:
        spare.set_visible(False)
    figure.supylabel("error left, along the joint's own motion [mm]", fontsize=10)
    legend_below(grid[0], 2)
    return figure


def _cloud(axes: Any, x: Floats, y: Floats, label: str) -> None:
    dots = chosen_rows(len(x), _DOTS)
    axes.plot(x[dots], y[dots], ".", color=GREEN, label="rows", **_look(len(x)))
    if len(x) > _FEWEST:
        Binned.of(x, y, _BINS).draw(axes, "black", "mean of neighbours with its 95 % band")
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    axes.set_xlabel(label, labelpad=1)
