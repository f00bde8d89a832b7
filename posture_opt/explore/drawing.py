"""Solids, grids and frames on the page, in the colours of the figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.interactive.triangles import Triangles
from posture_opt.report.scene.arm_solids import COLOURS, Role, Solid

if TYPE_CHECKING:
    import viser

_HANDLE_PIXELS, _HANDLE_LINE_PIXELS = 100.0, 6.0
"""Of the handles: a finger meets what is 24 pixels wide (WCAG 2.2, 2.5.8); of an arrow 4.5 lines are."""
OPACITY: dict[Role, float] = {"obstacle": 0.55, "floor": 0.6, "region": 0.5}


def rgb(colour: str) -> tuple[int, int, int]:
    """``#RRGGBB`` as three numbers.

    Example:
        >>> rgb("#0072B2")
        (0, 114, 178)
    """
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


def add_solid(server: viser.ViserServer, name: str, solid: Solid) -> Any:
    """A solid on the page; obstacles let through what is behind them."""
    flat = solid.role in ("obstacle", "floor", "base")
    mesh, near_side = Triangles.of([solid.faces]), solid.role == "obstacle"
    colour, opacity = COLOURS[solid.role], OPACITY.get(solid.role, 1.0)
    return add_mesh(server, name, _outward(mesh) if near_side else mesh, colour, opacity, flat, near_side)


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
    return server.scene.add_transform_controls(
        name, scale=_HANDLE_PIXELS, line_width=_HANDLE_LINE_PIXELS, fixed=True, disable_rotations=True,
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


def _outward(mesh: Triangles) -> Triangles:
    """The same convex surface with corners that run counterclockwise as seen from outside."""
    a, b, c = (mesh.corners[mesh.faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - mesh.corners.mean(axis=0)) < 0
    return Triangles(mesh.corners, np.where(inward[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces), mesh.owner)
