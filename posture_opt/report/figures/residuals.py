"""The figures of a calibration's residuals: what is drawn of them, and errors as arrows in the workspace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array, Codes, round_below, stacked_rows
from posture_opt.report.page.colours import MODEL_COLOURS
from posture_opt.report.page.style import new_figure, styled
from posture_opt.report.scene.arm_geometry import enlargement
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.units import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt import Calibration, Measurements, Robot
    from posture_opt.calibration.estimation.residuals import Residuals


TITLES = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated")}


@dataclass(frozen=True, eq=False)
class Shown:
    """What is drawn of a calibration, outliers left out.

    Args:
        residuals: the arm against the rows; ``x`` the calibrated deviations.
        errors: by model, (N, 3) measured minus model, cross-validated [mm].
        places: (N, 3) where, measured or the touched point [mm].
        columns: by joint, (N, 3) how the joint moves the tool point [m/rad or m/m].
        base: (3,) base of the calibrated arm [mm].
    """

    residuals: Residuals
    x: Array
    errors: dict[str, Array]
    places: Array
    columns: tuple[Array, ...]
    base: Array
    axes: tuple[int, ...]

    @classmethod
    def of(cls, found: Calibration) -> Shown:
        """The rows of a calibration that count."""
        kept = found.kept_rows
        residuals = found.residuals.take(kept)
        reached = residuals.walk(found.x)
        errors = {"nominal": -1e3 * found.errors_nominal[kept], "calibrated": -1e3 * found.errors[kept]}
        position, data = residuals.data.position, residuals.data
        places = stacked_rows(reached.position, len(kept)) if position is None else position
        places = residuals.places(found.x)[data.point, :3] if data.touches else places
        origin = reached.screws[len(residuals.robot.base)].origin
        columns = tuple(residuals.reading_shifts(residuals.robot.driven, found.x))
        return cls(
            residuals, found.x, errors, 1e3 * places, columns, 1e3 * stacked_rows(origin, len(kept))[0],
            tuple(int(axis) for axis in residuals.axes),
        )  # fmt: skip

    def error_label(self, axis: int) -> str:
        """The label of an axis of a figure over errors of one number of a reading."""
        name = self.data.kind.axis_names[axis]
        return f"error in {name} [mm]" if len(name) == 1 else f"error {name} [mm]"

    @property
    def robot(self) -> Robot:
        """The arm that was calibrated."""
        return self.residuals.robot

    @property
    def data(self) -> Measurements:
        """The rows that were kept, in their order."""
        return self.residuals.data

    @property
    def views(self) -> tuple[tuple[int, int], ...]:
        """The pairs of axes to look along the third of: one of what is flat, else from above and from the side."""
        if len(self.axes) == 2:
            return ((self.axes[0], self.axes[1]),)
        extent = np.ptp(self.places, axis=0)
        flat = int(np.argmin(extent))
        # Points that leave a plane by less than 2 % of the workspace are drawn in it.
        if extent[flat] < 0.02 * extent.max():
            first, second = (axis for axis in range(3) if axis != flat)
            return ((first, second),)
        return (0, 1), (int(np.argmax(extent[:2])), 2)


def dots_look(n: int) -> dict[str, float]:
    """Size and opacity of n dots: the fewer, the larger, so that each is seen and many do not merge."""
    size = float(np.clip(60.0 / max(n, 1) ** 0.5, 3.5, 9.0))
    return {"ms": size, "alpha": 0.75 if n < 400 else 0.45}


def chosen_rows(n: int, most: int) -> Codes:
    """At most ``most`` of n rows, drawn at random so that no regular grid hides among them; always the same.

    >>> chosen_rows(3, 10).tolist()
    [0, 1, 2]
    >>> len(chosen_rows(1000, 10))
    10
    """
    return np.arange(n) if n <= most else np.sort(np.random.default_rng(0).choice(n, most, replace=False))


@styled
def plot_residual_vectors(shown: Shown) -> Figure:
    """Errors as arrows from the model's place to the measured one, before and after. Axes are coordinates [mm] in the
    world frame; arrows are enlarged by the factors in the titles, keys show the length of large ones. Both have one
    scale unless arrows after calibration would be too short to be seen."""
    views = shown.views
    # More arrows hide each other.
    rows = chosen_rows(len(shown.data), 400)
    large = {name: float(np.quantile(np.linalg.norm(e, axis=1), 0.95)) for name, e in shown.errors.items()}
    factors = _factors(large, float(np.ptp(shown.places, axis=0).max()))
    ends = np.concatenate(
        [shown.places[rows], *((shown.places + factors[name] * e)[rows] for name, e in shown.errors.items())]
    )
    boxes = [(ends[:, list(view)].min(axis=0), ends[:, list(view)].max(axis=0)) for view in views]
    heights = [float(np.clip(3.4 * (high - low)[1] / (high - low)[0], 1.4, 5.0)) for low, high in boxes]
    figure = new_figure(sum(heights) + 0.8)
    grid = figure.subplots(len(views), 2, squeeze=False, gridspec_kw={"height_ratios": heights})
    drawn = []
    for line, view, box in zip(grid, views, boxes, strict=True):
        for axes, (name, errors) in zip(line, shown.errors.items(), strict=True):
            drawn.append(_arrows(axes, shown, errors, view, rows, factors[name], MODEL_COLOURS[name]))
            (left, low), (right, high) = box
            margin = 0.03 * max(right - left, high - low)
            axes.set(xlim=(left - margin, right + margin), ylim=(low - margin, high + margin))
            if view == views[0]:
                axes.set_title(f"{TITLES[name]}, {factors[name]:g}\N{MULTIPLICATION SIGN}", loc="left")
                key = round_below(large[name]) if large[name] > 0 else 1.0
                label = f"{number(key, 1)} mm  "
                axes.quiverkey(drawn[-1], 0.86, 1.04, key * factors[name], label, labelpos="W", color="black")
        line[1].tick_params(labelleft=False)
        line[1].set_ylabel("")
    some = f", {len(rows)} of {len(shown.data)} rows drawn by lot" if len(rows) < len(shown.data) else ""
    figure.suptitle(f"measured minus model, enlarged as said above each column{some}")
    return figure


def _factors(large: dict[str, float], extent: float) -> dict[str, float]:
    """By which the arrows of each model are enlarged: shorter ones than 0.6 of the other's have their own factor."""
    common = max(large.values())
    alike = min(large.values()) > 0.6 * common
    return {name: enlargement(common if alike else size, extent) for name, size in large.items()}


def _arrows(
    axes: Axes, shown: Shown, errors: Array, view: tuple[int, int], rows: Any, factor: float, colour: str
) -> Any:
    """The arrows of one model in one view, with the base; what it returns serves the key of their length; ``errors``
    (N, 3) [mm]."""
    x, y = shown.places[rows][:, list(view)].T
    u, v = factor * errors[rows][:, list(view)].T
    base = shown.base[list(view)]
    axes.plot(*base, "s", color="black", ms=7, zorder=3)
    axes.annotate("base", (base[0], base[1]), xytext=(6, 6), textcoords="offset points", annotation_clip=True)
    axes.plot(x, y, ".", color=colour, ms=2, alpha=0.6, zorder=2)
    axes.set(xlabel=f"{'xyz'[view[0]]} [mm]", ylabel=f"{'xyz'[view[1]]} [mm]", aspect="equal")
    axes.locator_params(nbins=6)
    return axes.quiver(
        x, y, u, v, color=colour, angles="xy", scale_units="xy", scale=1, width=0.0035, headwidth=3.5, zorder=4
    )
