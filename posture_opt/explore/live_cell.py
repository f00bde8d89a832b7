"""``LiveCell``: the obstacles on the page, the handle that moves one of them, and the narrowest gap."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.collision.narrowest import Gap
from posture_opt.collision.scene import Scene
from posture_opt.explore.drawing import add_handle, add_lines, add_solid
from posture_opt.numerics import Array
from posture_opt.report.page.colours import VERMILLION
from posture_opt.report.scene.arm_geometry import ArmGeometry, obstacles_near

if TYPE_CHECKING:
    import viser


class LiveCell:
    """What stands around the arm.

    Args:
        server: of the page.
        geometry: of the first answer: what is near that arm is drawn.
        moved: called with the place (3,) [m] that the chosen obstacle is dragged to.
    """

    def __init__(self, server: viser.ViserServer, geometry: ArmGeometry, moved: Callable[[Array], None]) -> None:
        self._server, self._points = server, geometry.points
        self._drawn: dict[str, tuple[object, Any]] = {}
        if geometry.floor is not None:
            add_solid(server, "/cell/floor", geometry.floor)
        self._gap: Any = None
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
        middle = tuple(ends.mean(axis=0))
        if self._label is None:
            self._label = self._server.scene.add_label("/gap/label", words, position=middle, anchor="bottom-center")
        self._label.text, self._label.position = words, middle
