"""``Marks``: the errors of measurements at the tool points of their rows, in colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Mask
from posture_opt.problem.problem import Problem
from posture_opt.report.page.colours import mapped_colours
from posture_opt.report.scene.arm_geometry import enlargement
from posture_opt.report.scene.arm_solids import ArmSolids

if TYPE_CHECKING:
    import viser

ERROR_COLOUR = "error"
"""The colours of the errors themselves."""
_ARROW_SHARES = 0.006, 0.014, 0.03  # of the arm's extent: radius of shaft and head, length of the head
_POINT_SHARE = 0.012  # of the arm's extent: the mark at a tool point
_SEEN_QUANTILE = 0.95  # of the errors: what the round factor of the arrows suits


@dataclass(frozen=True)
class Marks:
    """An arrow from the model to what was measured where the error is a vector in space, else a coloured point.

    Args:
        problem: whose arm it is.
        data: N rows; ``errors`` (N, 3) [m], and (N,) which of them count.
        values: (N,) that are shown in colours.
        extent: of the arm [m]; ``scale`` of the arrows about the round factor.
    """

    problem: Problem
    data: Measurements
    errors: tuple[Array, Mask]
    values: Array
    extent: float
    scale: float

    @cached_property
    def factor(self) -> float:
        """By which arrows are enlarged."""
        errors, kept = self.errors
        size = float(np.quantile(np.linalg.norm(errors[kept], axis=1), _SEEN_QUANTILE))
        return enlargement(size, self.extent) * self.scale

    def draw(self, server: viser.ViserServer) -> None:
        """Puts them on the page, in place of those before."""
        errors, kept = self.errors
        solids = ArmSolids(self.problem.robot)
        places = np.array([solids.frames(row)[-1][:3, 3] for row in self.data.q[kept]])
        values = self.values[kept]
        colours = mapped_colours(values, float(values.min()), float(values.max())).astype(np.uint8)
        server.scene.remove_by_name("/measured")
        if are_vectors(self.data):
            shaft, head, length = (share * self.extent for share in _ARROW_SHARES)
            ends = np.stack([places, places + self.factor * errors[kept]], axis=1)
            server.scene.add_arrows(
                "/measured/errors", ends, colours, shaft_radius=shaft, head_radius=head, head_length=length
            )
        else:
            size = _POINT_SHARE * self.extent
            server.scene.add_point_cloud(
                "/measured/errors", places, colours, point_size=size, point_shape="circle", precision="float32"
            )


def are_vectors(data: Measurements) -> bool:
    """Whether the errors of a row are a vector in space, not one or two numbers of an instrument."""
    return len(data.kind.axis_names) == 3


def colourings(problem: Problem, data: Measurements) -> dict[str, Callable[[Array], Array]]:
    """What is shown in colours -> its values (N,) for errors (N, 3): joints, sides they came from, time, the error."""
    found: dict[str, Callable[[Array], Array]] = {}
    for k, name in enumerate(problem.robot.joint_names):
        found[f"value of {name}"] = lambda _, k=k: data.q[:, k]  # type: ignore[misc]
    for k, name in enumerate(problem.robot.joint_names):
        found[f"side of {name}"] = lambda _, k=k: data.approach[:, k]  # type: ignore[misc]
    if data.time is not None:
        time = data.time
        found["time"] = lambda _: time
    found[ERROR_COLOUR] = _signed if len(data.kind.axis_names) == 1 else _size
    return found


def _signed(errors: Array) -> Array:
    return np.asarray(errors[:, 0])


def _size(errors: Array) -> Array:
    return np.asarray(np.linalg.norm(errors, axis=1))
