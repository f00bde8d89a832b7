"""Each named effect as a curve with the errors behind it, and what is left of the errors over every joint.

Curves are partial residuals: the rows' errors with all of the model taken off except the one effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores.lack_of_fit import side_place
from posture_opt.model.effects.base.cause import Abscissa, over_joint, over_phase
from posture_opt.model.effects.base.multiples import cycles_text
from posture_opt.model.effects.cyclic_error import CyclicError
from posture_opt.numerics import Array
from posture_opt.report.figures.residual_trends import MEAN, draw_trend
from posture_opt.report.page.colours import BLUE, GREEN, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.style import legend, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis


_MAX_CURVES = 12  # panels
_MAX_BINS = 24
_MIN_LEVER_SHARE = 0.1  # of the longest: nearer to its axis, a joint moves the tool point in no direction to speak of
_SIDE_DOTS = {-1.0: ("<", ORANGE, "joint arrives decreasing"), 1.0: (">", PURPLE, "joint arrives increasing")}


@dataclass(frozen=True, eq=False)
class Curve:
    """What is drawn of one effect; ``x`` (n,), ``side`` (n,), ``errors`` (n,), ``modelled`` (n,)."""

    x: Array
    side: Array
    errors: Array
    modelled: Array
    xlabel: str
    ylabel: str


@styled
def plot_curves(found: Diagnosis) -> Figure:
    """Each modelled effect, and what the data say of it once everything else is taken off. Dots are rows over what the
    effect depends on (joint angle, torque, temperature, …), the black line is their mean with its 95 % band, the
    coloured one the effect as fitted. Where the band leaves the curve, the effect has another form."""
    tangents = EffectSensitivities(found.model.residuals, found.model.x)
    shown = shown_curves(found)
    columns = min(len(shown), 2)
    rows = math.ceil(len(shown) / columns)
    figure = new_figure(0.8 + (2.6 if columns == 2 else 3.4) * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (place, finding, line) in zip(grid, shown, strict=False):
        _panel(axes, curve_of(found, tangents, place, finding, line))
        lines, title = finding.cause.spectral_lines, finding.label
        if lines and _is_slow(finding, line):
            title = f"{finding.target}: slow error over its range"
        elif lines:
            title = f"{finding.target}: {cycles_text(lines[line])} cycles per revolution"
        axes.set_title(fill(title, 44))
    for axes in grid[len(shown) :]:
        axes.set_visible(False)
    legend(figure)
    return figure


def shown_curves(found: Diagnosis) -> list[tuple[int, Finding, int]]:
    """(place, finding, line) of what is drawn: every effect, of cyclic errors as many lines as there is room for."""
    effects = found.fitted_effects[:_MAX_CURVES]
    lines = [max(len(f.cause.spectral_lines), 1) for _, f in effects]
    most = 1
    while sum(min(n, most + 1) for n in lines) <= _MAX_CURVES and most < max(lines, default=0):
        most += 1
    return [(i, f, line) for (i, f), n in zip(effects, lines, strict=True) for line in range(min(n, most))]


def _is_slow(finding: Finding, line: int) -> bool:
    return isinstance(finding.cause, CyclicError) and line not in finding.cause.sharp(finding.sizes.span)


def _panel(axes: Axes, curve: Curve) -> None:
    """One effect; a curve for each side of approach where it has two."""
    sides = np.unique(curve.side[curve.side != 0]).tolist()  # where nobody knows the side, neither curve is meant
    for side in sides:
        mine = curve.side == side
        dots = (".", BLUE, "rows") if len(sides) < 2 else _SIDE_DOTS[side]
        draw_trend(axes, curve.x[mine], curve.errors[mine], dots, bins=_MAX_BINS)
        order = np.argsort(curve.x[mine])
        effect = curve.modelled[mine][order]
        axes.plot(curve.x[mine][order], effect, color=VERMILLION, lw=2, zorder=3.5, label="modelled effect")
    low, high = np.quantile(curve.errors, [0.01, 0.99])
    low, high = min(low, curve.modelled.min(), 0.0), max(high, curve.modelled.max(), 0.0)
    margin = 0.07 * max(high - low, 1e-9)
    left, right = np.quantile(curve.x, [0.002, 0.998])
    pad = 0.04 * max(right - left, 1e-9)
    axes.set(xlim=(left - pad, right + pad), ylim=(low - margin, high + margin))
    axes.set(xlabel=curve.xlabel, ylabel=curve.ylabel)


def curve_of(
    found: Diagnosis, sensitivities: EffectSensitivities, place: int, finding: Finding, line: int = 0
) -> Curve:
    """The curve of one effect over its abscissa; of one that depends on several things, as modelled against as seen."""
    model, residuals = found.model, found.model.residuals
    shape = (len(residuals.data), residuals.block)
    several = len(model.effects[place].spectral_lines) > 1
    own = model.effects[place].size_parts[finding.stated_parts[line]]
    modelled = (model.effect_columns(place)[:, own] @ model.x[model.slices[place]][own]).reshape(shape)
    partial = modelled - model.whitened.reshape(shape)
    effect = finding.effect
    assert effect is not None
    over = effect.abscissa(sensitivities.state, residuals.data.time is not None)
    moved = {j for one in effect.sensitivities(sensitivities.state) for j in one.joints}
    if _is_slow(finding, line):
        over = over_joint(sensitivities.state, min(moved))
    elif several:
        over = over_phase(sensitivities.state, min(moved), finding.cause.spectral_lines[line])
    if over is not None and len(moved) == 1:
        return _joint_curve(sensitivities, moved.pop(), over, partial, modelled)
    axes = slice(0, len(residuals.axes))
    seen, said = (1e3 * residuals.sigma * v[:, axes] for v in (partial, modelled))
    if over is not None:
        # Effects that move the tool point alike in all rows, along the mean shift.
        mean = said.mean(axis=0)
        along = mean / max(float(np.linalg.norm(mean)), 1e-300)
        return Curve(over.values, over.side, seen @ along, said @ along, over.label, "error along the shift [mm]")
    # Errors along the modelled effect of each row, over its size; on the diagonal it is true.
    size = np.linalg.norm(said, axis=1)
    some = size > _MIN_LEVER_SHARE * size.max()
    errors, one = np.sum(seen[some] * said[some], axis=1) / size[some], np.ones(int(some.sum()))
    return Curve(size[some], one, errors, size[some], "modelled effect at the tool [mm]", "measured along it [mm]")


def _joint_curve(
    sensitivities: EffectSensitivities, joint: int, over: Abscissa, partial: Array, modelled: Array
) -> Curve:
    """Errors of a joint [mrad or µm], in the rows in which it moves the tool point: ``e·c / c·c`` with its column c;
    ``partial`` (N, b), ``modelled`` (N, b)."""
    column = sensitivities.joints[joint]
    square = np.sum(column**2, axis=1)
    far = square > (_MIN_LEVER_SHARE**2) * square.max()
    revolute = sensitivities.residuals.robot.joints[joint].type == "revolute"
    factor, unit = (1e3, "mrad") if revolute else (1e6, "µm")
    errors, curve = (factor * np.sum(e * column, axis=1)[far] / square[far] for e in (partial, modelled))
    return Curve(over.values[far], over.side[far], errors, curve, over.label, f"error of the joint [{unit}]")


@styled
def plot_left(found: Diagnosis) -> Figure:
    """What the model with its effects leaves [mm], along the motion of each joint over its value, and over the rows. A
    mean of neighbours that leaves zero beyond its band is structure that no named effect explains. Rows in which a
    joint hardly moves the tool point are left out of its panel; joints that did not move have none."""
    residuals = found.model.residuals
    tangents = EffectSensitivities(residuals, found.model.x)
    e = -found.model.whitened.reshape(len(residuals.data), residuals.block)
    moving = [k for k in range(residuals.robot.n) if np.ptp(residuals.data.q[:, k]) > 1e-6]
    sided = _left_by_side(found)
    rows = math.ceil((len(moving) + 1) / 2)
    figure = new_figure(0.8 + 1.9 * rows)
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    for axes, joint in zip(grid, moving, strict=False):
        column = tangents.joints[joint]
        lever = np.linalg.norm(column, axis=1)
        far = lever > _MIN_LEVER_SHARE * lever.max()
        along = 1e3 * residuals.sigma * np.sum(e * column, axis=1)[far] / lever[far]
        over = over_joint(tangents.state, joint)
        side = np.broadcast_to(np.asarray(tangents.state.inputs.side(joint)), len(e))[far]
        groups = {(".", GREEN, "rows"): np.ones(len(along), dtype=bool)}
        if sided and np.all([np.count_nonzero(side == s) > 4 for s in (-1, 1)]):
            groups = {_SIDE_DOTS[s]: side == s for s in (-1.0, 1.0)}
        for dots, own in groups.items():
            mean = MEAN if len(groups) == 1 else (dots[1], f"mean of neighbours, {dots[2]}")
            draw_trend(axes, over.values[far][own], along[own], dots, mean, _MAX_BINS)
        axes.set_xlabel(over.label, labelpad=1)
    axes = grid[len(moving)]
    lengths = 1e3 * residuals.sigma * np.linalg.norm(e[:, : len(residuals.axes)], axis=1)
    rows_by_time = np.arange(1, len(e) + 1, dtype=np.float64)
    draw_trend(axes, rows_by_time, lengths, (".", GREEN, "rows"), bins=_MAX_BINS)
    axes.set_xlabel("row, in the order of measuring (length of the error)", labelpad=1)
    high = float(np.quantile(lengths, 0.99))
    for panel in grid[: len(moving)]:
        panel.set_ylim(-high, high)
    axes.set_ylim(0, 1.2 * high)
    for spare in grid[len(moving) + 1 :]:
        spare.set_visible(False)
    figure.supylabel("error left, along the joint's own motion [mm]")
    legend(figure)
    return figure


def _left_by_side(found: Diagnosis) -> bool:
    if any(component.of_side for component in found.unexplained):
        return True
    return found.adequacy.place in map(side_place, found.model.residuals.data.joint_names)
