"""``LiveScene``: the arm at the answer, its error region, the target with its play, and the cell, on the page.

The solids move with their frames: a new posture sends one pose a frame. What has another shape in every posture, the
error region, is sent again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.explore.drawing import (
    OPACITY,
    add_grid,
    add_handle,
    add_lines,
    add_mesh,
    add_solid,
    rgb,
    wxyz,
)
from posture_opt.explore.live_cell import LiveCell
from posture_opt.explore.viewpoint import look_at
from posture_opt.numerics import Array
from posture_opt.report.interactive.triangles import Triangles, arrow
from posture_opt.report.page.colours import BLUE, PURPLE, VERMILLION
from posture_opt.report.scene.arm_geometry import (
    ARROW_SHARE,
    ArmGeometry,
    ErrorRegion,
    TargetGeometry,
    enlargement,
    frame_along,
)
from posture_opt.report.scene.arm_solids import COLOURS, ArmSolids
from posture_opt.uncertainty.simulation.cloud import cloud_of

if TYPE_CHECKING:
    import viser

    from posture_opt.selection.answer.solution import Solution
    from posture_opt.uncertainty.spread.spread import Spread

_PALE = 0.25  # opacity of the last posture where there is none for the target
_DRAWS = 2000  # of the Monte Carlo cloud: takes 2 ms
_POINT_SHARE, _BALL_SHARE = 0.006, 0.02  # of the arm's extent: a draw, and the ball at the nearest point
_LABEL_ROOM = 0.3  # of the arm's extent: what is seen below the tool point: the label
_LABEL_SHARE = 0.2  # of the arm's extent: the label is so far below the error region


@dataclass(frozen=True)
class Layers:
    """What is laid over the error region: a Monte Carlo cloud, the region of first order."""

    cloud: bool = False
    first_order: bool = False


Moved = Callable[[Array, bool], None]
"""Called with the place (3,) [m] that a handle was dragged to, and whether it was let go."""


class LiveScene:
    """What a page shows of one arm and its cell.

    Args:
        server: of the page.
        geometry: of the first answer; what stands still is drawn from it.
        arm: its solids.
        moved: called while the target is dragged; ``obstacle_moved`` while an obstacle is.
        places: (k, 3) where the tool point goes, or was [m]: to be seen at first.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        geometry: ArmGeometry,
        arm: ArmSolids,
        moved: Moved,
        obstacle_moved: Callable[[Array], None],
        places: Array,
    ) -> None:
        self._server, self._arm, self._extent = server, arm, geometry.extent
        self._down = np.array([0.0, -1.0, 0.0] if geometry.planar else [0.0, 0.0, -1.0])
        self._frames = [server.scene.add_frame(f"/arm/{k}", show_axes=False) for k in range(arm.robot.n + 2)]
        kept = {solid.role for solid in geometry.solids} | {"link", "joint", "tool"}
        self._bodies = [
            add_solid(server, f"/arm/{solid.frame}/{k}", solid)
            for k, solid in enumerate(arm.solids)
            if solid.role in kept
        ]
        self.cell: LiveCell = LiveCell(server, geometry, obstacle_moved)
        self.handle: Any = self._handle(geometry.planar, moved)
        self._label: Any = None
        self._ring_label: Any = None
        self._reachable = server.scene.add_icosphere(
            "/reachable", _BALL_SHARE * self._extent, rgb(VERMILLION), visible=False, cast_shadow=False
        )
        label = geometry.tool_point + _LABEL_ROOM * self._extent * self._down
        look_at(server, geometry.planar, np.concatenate([geometry.points, places, label[None]]))

    def show(self, solution: Solution, layers: Layers = Layers()) -> None:
        """The posture of a solution with its error region, and its target with the play on the same scale."""
        self._show(solution.spread, TargetGeometry.of(solution.target), layers)

    def show_own(self, spread: Spread, layers: Layers = Layers()) -> None:
        """A posture of the user's own with its error region."""
        self._show(spread, None, layers)

    def _show(self, spread: Spread, target: TargetGeometry | None, layers: Layers) -> None:
        """What follows a posture; the enlargement is that of the arm as it stood at first, and so does not flicker."""
        region = ErrorRegion.of(spread, enlargement(float(spread.region(0.95)[-1]), self._extent))
        with self._server.atomic():
            self._pose(self._arm.frames(spread.q))
            self._region(region)
            self._lay_over(spread, region.factor, layers)
            self._reachable.visible = False
            if target is not None:
                self._target(target, region, spread.position)
            self._fade(1.0)
        self._server.flush()

    def place_handle(self, position: Array) -> None:
        """The handle at a place [m], as nobody drags it."""
        self.handle.position = tuple(position)

    def fade(self, reachable: Array | None = None) -> None:
        """The last posture pale: it is no answer to what is asked; a ball at the nearest point (3,) that is reached."""
        self._fade(_PALE)
        if reachable is not None:
            self._reachable.position = tuple(reachable)
        self._reachable.visible = reachable is not None
        self._server.flush()

    def _lay_over(self, spread: Spread, factor: float, layers: Layers) -> None:
        """The cloud and the region of first order, on the scale of the error region and about its middle."""
        scene, middle = self._server.scene, spread.position + spread.bias
        if layers.cloud:
            points = middle + factor * (cloud_of(spread, _DRAWS, 0).points - middle)
            size = _POINT_SHARE * self._extent
            scene.add_point_cloud(
                "/layers/cloud", points, rgb(BLUE), point_size=size, point_shape="circle", precision="float32"
            )
        else:
            scene.remove_by_name("/layers/cloud")
        if layers.first_order:
            first = replace(spread, covariance=spread.covariance_first_order, bias=np.zeros(3))
            surface = ErrorRegion.of(first, factor).surface()
            add_grid(self._server, "/layers/first_order", surface, PURPLE)
        else:
            scene.remove_by_name("/layers/first_order")

    def _fade(self, opacity: float) -> None:
        for body in self._bodies:
            body.opacity = None if opacity == 1.0 else opacity

    def _pose(self, frames: Array) -> None:
        """The solids where their frames (n + 2, 4, 4) are."""
        for node, T in zip(self._frames, frames, strict=True):
            node.wxyz, node.position = wxyz(T[:3, :3]), T[:3, 3]

    def _region(self, region: ErrorRegion) -> None:
        """The error region, and how much it is enlarged."""
        mesh = Triangles.of([region.faces()])
        add_mesh(self._server, "/answer/region", mesh, COLOURS["region"], OPACITY["region"])
        text, place = region.label, region.center + _LABEL_SHARE * self._extent * self._down
        if self._label is None:
            self._label = self._server.scene.add_label(
                "/answer/label", text, position=tuple(place), anchor="top-center"
            )
        self._label.text, self._label.position = text, tuple(place)

    def _target(self, target: TargetGeometry, region: ErrorRegion, tool_point: Array) -> None:
        """The direction of the task and the rim of the hole with its label, enlarged as the region is."""
        scene, place, shaft = self._server.scene, tool_point if target.kind != "point" else target.lower, arrow()
        corners = place + self._extent * ARROW_SHARE * (shaft.corners - [0, 0, 1.0]) @ frame_along(target.direction).T
        arrow_mesh = Triangles(corners, shaft.faces, shaft.owner)
        add_mesh(self._server, "/answer/direction", arrow_mesh, COLOURS["direction"], 1.0)
        ring = target.ring(region.factor, place, self._extent)
        if ring is None:
            scene.remove_by_name("/answer/ring")
            self._ring_label = None
            return
        points = ring.points()
        segments = np.stack([points[:-1], points[1:]], axis=1)
        add_lines(self._server, "/answer/ring/rim", segments, COLOURS["ring"], 3.0)
        if self._ring_label is None:
            self._ring_label = scene.add_label("/answer/ring/label", ring.label, anchor="center-left")
        self._ring_label.text, self._ring_label.position = ring.label, tuple(points[np.argmax(points[:, 0])])

    def _handle(self, planar: bool, moved: Moved) -> Any:
        handle = add_handle(self._server, "/target", planar)

        @handle.on_update
        async def _(event: Any) -> None:
            moved(np.array(event.target.position, dtype=float), event.phase == "end")

        return handle
