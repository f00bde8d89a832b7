"""The tasks of the fleet: what is asked of an arm, and which of its numbers are uncertain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from posture_opt.robot.robot import Robot

Errors = Literal["joints", "geometry", "correlated"]

JOINT_SIGMA = 0.3e-3  # rad, as of the selection benchmark; each joint half to twice of it
SLIDE_SIGMA = 0.05e-3  # m
LENGTH_SIGMA = 0.05e-3  # m
FRAME_SIGMA = (0.1e-3, 0.2e-3)  # m and rad, of base and tool
CORRELATIONS = (0.8, -0.6)  # of the first two joints, and of the next two


@dataclass(frozen=True)
class FleetTask:
    """One kind of task.

    Args:
        section: keys of ``task`` beside position, direction and tool axis.
        aligned: whether the tool axis is asked for.
        half_box: half sides of a region about the position [m], none for a point.
        margin: least distance of every turning joint from its limits [rad].
    """

    name: str
    section: dict[str, Any]
    errors: Errors = "joints"
    aligned: bool = True
    tilt: float = 0.0
    half_box: tuple[float, float, float] = (0.0, 0.0, 0.0)
    margin: float = 0.0

    @property
    def kind(self) -> str:
        return str(self.section["kind"])

    @property
    def within(self) -> str:
        """The part of the spread that counts, by the definition of the kind of task."""
        return {"probe": "along", "measure": "all"}.get(self.kind, "across")

    @property
    def criterion(self) -> str:
        return str(self.section["criterion"])

    @property
    def document(self) -> dict[str, Any]:
        """The section ``task`` without its target."""
        rows = {"tilt": f"{self.tilt!r} rad"} if self.tilt else {}
        margin = [{"kind": "limit_margin", "at_least": f"{self.margin!r} rad"}]
        return self.section | rows | ({"subject_to": margin} if self.margin else {})


def _task(name: str, kind: str, criterion: str, errors: Errors = "joints", **more: Any) -> FleetTask:
    return FleetTask(name, {"kind": kind, "criterion": criterion}, errors, kind not in ("measure", "trace"), **more)


TILT = float(np.deg2rad(10.0))
BOX = (0.05, 0.04, 0.02)

TASKS: tuple[FleetTask, ...] = (
    _task("worst", "insert", "worst"),
    _task("trace_criterion", "insert", "trace", "geometry"),
    _task("area", "insert", "area", "geometry"),
    _task("miss", "insert", "miss", "geometry"),
    _task("tilt", "insert", "worst", tilt=TILT),
    _task("region", "insert", "worst", "geometry", half_box=BOX),
    _task("correlated", "insert", "worst", "correlated"),
    _task("probe", "probe", "worst"),
    _task("measure", "measure", "trace", "geometry"),
    _task("measure_worst", "measure", "worst"),
    _task("place", "place", "trace", "correlated"),
    _task("drill", "drill", "worst", "geometry"),
    _task("trace", "trace", "worst"),
    _task("margin", "insert", "worst", "geometry", margin=float(np.deg2rad(5.0))),
    _task("miss_tilt", "insert", "miss", tilt=TILT),
    _task("tilt_region", "insert", "trace", tilt=TILT, half_box=BOX),
)


def uncertainty(robot: Robot, errors: Errors, rng: np.random.Generator) -> dict[str, Any]:
    """The section ``uncertainty``: noise of every joint, and with it lengths and frames, or correlations."""
    sigma: dict[str, str] = {}
    driven = [f for f in robot.factors if f.joint is not None]
    for f in driven:
        size, unit = (JOINT_SIGMA, "rad") if f.kind == "rotate" else (SLIDE_SIGMA, "m")
        sigma[f.parameter] = f"{size * 2.0 ** rng.uniform(-1, 1):.6g} {unit}"
    if errors == "correlated":
        names = [f.parameter for f in driven]
        pairs = zip(names[0::2], names[1::2], CORRELATIONS, strict=False)
        return {"sigma": sigma, "correlation": [[a, b, r] for a, b, r in pairs]}
    if errors == "geometry":
        for f in robot.factors:
            frame = f.parameter.split(".")[0] in ("base", "tool")
            if f.joint is not None or not f.parameter or (f.kind == "rotate" and not frame):
                continue
            size = FRAME_SIGMA[f.kind == "rotate"] if frame else LENGTH_SIGMA
            sigma[f.parameter] = f"{size:.6g} {'rad' if f.kind == 'rotate' else 'm'}"
    return {"sigma": sigma}
