"""Solids, grids and frames on the page, in the colours of the figures."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.scene.arm_solids import COLOURS, Role, Solid
from posture_opt.report.scene.arm_view import Triangles

if TYPE_CHECKING:
    import viser

OPACITY: dict[Role, float] = {"obstacle": 0.55, "floor": 0.6, "region": 0.5}


def rgb(colour: str) -> tuple[int, int, int]:
    """``#RRGGBB`` as three numbers."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


def add_solid(server: viser.ViserServer, name: str, solid: Solid) -> Any:
    """A solid on the page; obstacles let through what is behind them."""
    flat = solid.role in ("obstacle", "floor", "base")
    mesh, near_side = Triangles.of([solid.faces]), solid.role == "obstacle"
    if near_side:  # a convex surface, whose corners are to run counterclockwise as seen from outside
        a, b, c = (mesh.corners[mesh.faces[:, k]] for k in range(3))
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - mesh.corners.mean(axis=0)) < 0
        faces = np.where(inward[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
        mesh = Triangles(mesh.corners, faces, mesh.owner)
    return add_mesh(server, name, mesh, COLOURS[solid.role], OPACITY.get(solid.role, 1.0), flat, near_side)


def add_mesh(
    server: viser.ViserServer,
    name: str,
    mesh: Triangles,
    colour: str,
    opacity: float = 1.0,
    flat: bool = False,
    near_side: bool = False,
) -> Any:
    """A mesh in one colour; with ``near_side`` what turns away is not drawn: seen through, both would show as tiles."""
    return server.scene.add_mesh_simple(
        name,
        mesh.corners,
        mesh.faces,
        color=rgb(colour),
        opacity=None if opacity == 1.0 else opacity,
        side="front" if near_side else "double",
        flat_shading=flat,
        cast_shadow=False,
        receive_shadow=False,
    )


def add_handle(
    server: viser.ViserServer, name: str, planar: bool, visible: bool = True
) -> viser.TransformControlsHandle:
    """What is dragged: along axes and in planes, of a planar arm in its plane alone; as large in pixels at any zoom."""
    # A finger meets what is 24 pixels wide (WCAG 2.2, 2.5.8): 4.5 lines of an arrow are.
    return server.scene.add_transform_controls(
        name, scale=100.0, line_width=6.0, fixed=True, disable_rotations=True,
        active_axes=(True, True, not planar), depth_test=False, visible=visible,
    )  # fmt: skip


def add_grid(server: viser.ViserServer, name: str, surface: Array, colour: str) -> None:
    """The lines of a surface (a, b, 3) [m]: along its rims, and every fourth along its rows."""
    lines = [surface[k] for k in range(0, len(surface), 4)] if len(surface) > 4 else [surface[-1]]
    lines += [surface[:, k] for k in range(0, surface.shape[1], 4)] if len(surface) > 4 else []
    segments = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    add_lines(server, name, segments, colour, 2.0)


def add_lines(server: viser.ViserServer, name: str, segments: Array, colour: str, thickness: float) -> Any:
    """Segments (k, 2, 3) [m], so many pixels thick."""
    return server.scene.add_line_segments(name, segments, rgb(colour), thickness=thickness, thickness_units="screen")


def wxyz(R: Array) -> Array:
    """(4,) quaternion of a rotation (3, 3)."""
    from viser.transforms import SO3  # that of SciPy would be imported for this alone

    return np.asarray(SO3.from_matrix(R).wxyz)


def add_points(server: viser.ViserServer, name: str, points: Array, colours: Any, size: float) -> None:
    """Round points (k, 3) [m], ``size`` [m] wide."""
    server.scene.add_point_cloud(name, points, colours, point_size=size, point_shape="circle", precision="float32")


def put_label(server: viser.ViserServer, label: Any, name: str, words: str, place: Array, anchor: Any) -> Any:
    """A label at a place (3,) [m]; one that is there already is moved."""
    label = label or server.scene.add_label(name, words, position=tuple(place), anchor=anchor)
    label.text, label.position = words, tuple(place)
    return label


def line(words: str, alarm: bool = False) -> str:
    """Words as a line of the panel, read out by screen readers when it changes."""
    weight = "600" if alarm else "400"
    return f'<p style="margin:4px 14px;font-size:13px;font-weight:{weight}" role="status">{escape(words)}</p>'


def on_user(field: Any, call: Callable[[], object]) -> None:
    """Have a control call something when a browser changes it; what the program sets itself is no request."""
    field.on_update(lambda event: call() if event.client is not None else None)
