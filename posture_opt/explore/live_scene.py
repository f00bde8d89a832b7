"""``LiveScene``: the arm at the answer, its error region, the target with its play, the cell and the camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.collision.scene import Gap, Scene
from posture_opt.explore.drawing import (
    OPACITY,
    add_grid,
    add_handle,
    add_lines,
    add_mesh,
    add_points,
    add_solid,
    put_label,
    rgb,
    wxyz,
)
from posture_opt.numerics import Array
from posture_opt.report.page.colours import BLUE, PURPLE, VERMILLION
from posture_opt.report.scene.arm_geometry import (
    ARROW_SHARE,
    ArmGeometry,
    ErrorRegion,
    TargetGeometry,
    enlargement,
    extent_of,
    frame_along,
    obstacles_near,
)
from posture_opt.report.scene.arm_solids import COLOURS, ArmSolids
from posture_opt.report.scene.arm_view import Triangles, arrow
from posture_opt.selection.answer.solution import Solution
from posture_opt.uncertainty.cloud import cloud_of

if TYPE_CHECKING:
    import viser

    from posture_opt.uncertainty.spread import Spread


class LiveCell:
    """What stands around the arm.

    Args:
        moved: called with the place (3,) [m] that the chosen obstacle is dragged to.
    """

    def __init__(self, server: viser.ViserServer, geometry: ArmGeometry, moved: Callable[[Array], None]) -> None:
        self._server, self._points = server, geometry.points
        self._drawn: dict[str, tuple[object, Any]] = {}
        if geometry.floor is not None:
            add_solid(server, "/cell/floor", geometry.floor)
        self._label: Any = None
        self.handle: Any = add_handle(server, "/obstacle", geometry.planar, visible=False)

        @self.handle.on_update
        async def _(event: Any) -> None:
            moved(np.array(event.target.position, dtype=float))

    def show(self, scene: Scene) -> None:
        """The obstacles of a cell; those that stand as before are not sent again."""
        stated = {obstacle.name: obstacle.model_dump() for obstacle in scene.stated_obstacles}
        for name in [name for name, (obstacle, _) in self._drawn.items() if stated.get(name) != obstacle]:
            self._drawn.pop(name)[1].remove()
        for solid in obstacles_near(scene, self._points):
            if solid.name not in self._drawn:
                node = f"/cell/{list(stated).index(solid.name)}"
                self._drawn[solid.name] = stated[solid.name], add_solid(self._server, node, solid)

    def choose(self, place: Array | None) -> None:
        """The handle at the place (3,) [m] of the chosen obstacle; None hides it."""
        self.handle.visible = place is not None
        if place is not None:
            self.handle.position = tuple(place)

    def show_gap(self, gap: Gap | None) -> None:
        """The narrowest gap as a segment with its length."""
        if gap is None:
            self._server.scene.remove_by_name("/gap")
            self._label = None
            return
        ends, words = np.stack([gap.start, gap.end]), f"{1e3 * gap.distance:.1f} mm to {gap.between[1]}"
        add_lines(self._server, "/gap/line", ends[None], VERMILLION, 4.0)
        self._label = put_label(self._server, self._label, "/gap/label", words, ends.mean(axis=0), "bottom-center")


@dataclass(frozen=True)
class Layers:
    """What is laid over the error region: a Monte Carlo cloud, the region of first order."""

    cloud: bool = False
    first_order: bool = False


class LiveScene:
    """What a page shows of one arm and its cell.

    Args:
        places: (k, 3) where the tool point goes, or was [m]: to be seen at first.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        geometry: ArmGeometry,
        arm: ArmSolids,
        moved: Callable[[Array], None],
        obstacle_moved: Callable[[Array], None],
        places: Array,
    ) -> None:
        self._server, self._arm, self._extent = server, arm, geometry.extent
        self._down = np.array([0.0, -1.0, 0.0] if geometry.planar else [0.0, 0.0, -1.0])
        self._frames = [server.scene.add_frame(f"/arm/{k}", show_axes=False) for k in range(arm.robot.n + 2)]
        kept = {solid.role for solid in geometry.solids} | {"link", "joint", "tool"}
        solids = [(k, solid) for k, solid in enumerate(arm.solids) if solid.role in kept]
        self._bodies = [add_solid(server, f"/arm/{solid.frame}/{k}", solid) for k, solid in solids]
        self.cell: LiveCell = LiveCell(server, geometry, obstacle_moved)
        self.handle: Any = add_handle(server, "/target", geometry.planar)
        self._label: Any = None
        self._ring_label: Any = None
        self._reachable = server.scene.add_icosphere(
            "/reachable", 0.02 * self._extent, rgb(VERMILLION), visible=False, cast_shadow=False
        )
        label = geometry.tool_point + 0.3 * self._extent * self._down  # room for it
        look_at(server, geometry.planar, np.concatenate([geometry.points, places, label[None]]))

        @self.handle.on_update
        async def _(event: Any) -> None:
            moved(np.array(event.target.position, dtype=float))

    def show(self, shown: Solution | Spread, layers: Layers = Layers()) -> None:
        """A posture with its error region; of a solution its target too, with the play on the same scale."""
        spread = shown.spread if isinstance(shown, Solution) else shown
        region = ErrorRegion.of(spread, enlargement(float(spread.region(0.95)[-1]), self._extent))
        with self._server.atomic():
            for node, T in zip(self._frames, self._arm.frames(spread.q), strict=True):
                node.wxyz, node.position = wxyz(T[:3, :3]), T[:3, 3]
            mesh = Triangles.of([region.faces()])
            add_mesh(self._server, "/answer/region", mesh, COLOURS["region"], OPACITY["region"])
            below = region.center + 0.2 * self._extent * self._down
            self._label = put_label(self._server, self._label, "/answer/label", region.label, below, "top-center")
            self._lay_over(spread, region.factor, layers)
            self._reachable.visible = False
            if isinstance(shown, Solution):
                self._target(TargetGeometry.of(shown.target), region, spread.position)
            self._fade(1.0)
        self._server.flush()

    def fade(self, reachable: Array | None = None) -> None:
        """The last posture pale: it is no answer to what is asked; a ball at the nearest point (3,) that is reached."""
        self._fade(0.25)
        if reachable is not None:
            self._reachable.position = tuple(reachable)
        self._reachable.visible = reachable is not None
        self._server.flush()

    def _lay_over(self, spread: Spread, factor: float, layers: Layers) -> None:
        scene, middle = self._server.scene, spread.position + spread.bias
        if layers.cloud:
            points = middle + factor * (cloud_of(spread, 2000, 0).points - middle)  # takes 2 ms
            add_points(self._server, "/layers/cloud", points, rgb(BLUE), 0.006 * self._extent)
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

    def _target(self, target: TargetGeometry, region: ErrorRegion, tool_point: Array) -> None:
        """The direction of the task and the rim of the hole with its label, enlarged as the region is."""
        place, shaft = tool_point if target.kind != "point" else target.lower, arrow()
        corners = place + self._extent * ARROW_SHARE * (shaft.corners - [0, 0, 1.0]) @ frame_along(target.direction).T
        arrow_mesh = Triangles(corners, shaft.faces, shaft.owner)
        add_mesh(self._server, "/answer/direction", arrow_mesh, COLOURS["direction"], 1.0)
        ring = target.ring(region.factor, place, self._extent)
        if ring is None:
            self._server.scene.remove_by_name("/answer/ring")
            self._ring_label = None
            return
        points = ring.points()
        segments = np.stack([points[:-1], points[1:]], axis=1)
        add_lines(self._server, "/answer/ring/rim", segments, COLOURS["ring"], 3.0)
        name, end = "/answer/ring/label", points[np.argmax(points[:, 0])]
        self._ring_label = put_label(self._server, self._ring_label, name, ring.label, end, "center-left")


def look_at(server: viser.ViserServer, planar: bool, points: Array) -> None:
    """Have all points (k, 3) [m] seen, from above where the arm moves in a plane."""
    middle, extent = (points.min(axis=0) + points.max(axis=0)) / 2, extent_of(points)
    # From the middle of the arm to the viewer, in extents: room for the arm to move.
    offset = extent * np.array([0.0, -1e-3, 2.0] if planar else [0.9, -1.35, 0.9])
    server.scene.set_up_direction("+y" if planar else "+z")
    first = server.initial_camera
    first.look_at, first.fov, first.position = middle, math.radians(50.0), middle + offset

    @server.on_client_connect
    async def _(client: Any) -> None:
        stood = [1.0, 1.0]  # how far off it stands at first and stood last, in offsets

        async def fit(camera: Any) -> None:
            now, wanted = camera.position - middle, max(1.0, camera.image_height / max(camera.image_width, 1))
            there = any(np.linalg.norm(now - far * offset) < 0.01 * extent for far in stood)
            if there and np.linalg.norm(now - wanted * offset) > 0.01 * extent:  # until somebody turns or moves it
                stood[1] = wanted
                with client.atomic():
                    camera.position = middle + wanted * offset
                    camera.look_at = middle

        client.camera.on_update(fit)
