"""``look_at``: the camera of the page, which sees as much of the scene in a narrow window as in a wide one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.scene.arm_geometry import extent_of

if TYPE_CHECKING:
    import viser

_FIELD = math.radians(50.0)  # of view, from the lowest to the highest
_VIEW = np.array([0.9, -1.35, 0.9])  # from the middle of the arm to the viewer, in extents: room for the arm to move
_VIEW_ONTO_PLANE = np.array([0.0, -1e-3, 2.0])
_SAME = 0.01  # of the extent: places of the camera that are the same


def look_at(server: viser.ViserServer, planar: bool, points: Array) -> None:
    """Have all points (k, 3) [m] seen, from above where the arm moves in a plane.

    Where the window is narrower than high, the camera of that browser stands so much farther off, until somebody turns
    or moves it.
    """
    middle, extent = (points.min(axis=0) + points.max(axis=0)) / 2, extent_of(points)
    offset = extent * (_VIEW_ONTO_PLANE if planar else _VIEW)
    server.scene.set_up_direction("+y" if planar else "+z")
    first = server.initial_camera
    first.look_at, first.fov, first.position = middle, _FIELD, middle + offset

    @server.on_client_connect
    async def _(client: Any) -> None:
        stood = [1.0, 1.0]  # how far off it stands at first and stood last, in offsets

        async def fit(camera: Any) -> None:
            now, wanted = camera.position - middle, max(1.0, camera.image_height / max(camera.image_width, 1))
            there = any(np.linalg.norm(now - far * offset) < _SAME * extent for far in stood)
            if there and np.linalg.norm(now - wanted * offset) > _SAME * extent:
                stood[1] = wanted
                with client.atomic():
                    camera.position = middle + wanted * offset
                    camera.look_at = middle

        client.camera.on_update(fit)
