"""``ArmView``: an arm in several postures to choose from, with its target and surroundings, as plotly.js draws them.

Inside everything is in m and rad; the document for the page has mm and frames as twelve numbers ``R | t``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.collision.facets import cylinder_facets, tapered_facets
from posture_opt.numerics import Array, Codes, Json
from posture_opt.report.page.page import View
from posture_opt.report.scene.arm_geometry import (
    ARROW_SHARE,
    ErrorRegion,
    TargetGeometry,
    enlargement,
    extent_of,
    floor_under,
    frame_along,
    obstacles_near,
)
from posture_opt.report.scene.arm_solids import COLOURS, ArmSolids, Solid
from posture_opt.statements.notation import joint_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt import Robot, Spread
    from posture_opt.collision.scene import Scene

_SHAFT_RADIUS, _HEAD_RADIUS = 0.028, 0.075  # radii of an arrow of length 1


@dataclass(frozen=True)
class Triangles:
    """Surfaces as one mesh.

    Args:
        corners: (v, 3) [m]; ``faces`` (t, 3) numbers of the corners of each triangle.
        owner: (t,) number of the surface that each triangle is of.
    """

    corners: Array
    faces: Codes
    owner: Codes

    @classmethod
    def of(cls, surfaces: Sequence[Array]) -> Triangles:
        """Of surfaces, each of faces (k, 4, 3) [m]; no two share a corner."""
        corners, faces, owner, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=int)], [np.zeros(0, dtype=int)], 0
        for which, surface in enumerate(surfaces):
            flat = surface.reshape(-1, 3)
            # Corners nearer than 0.1 µm are one.
            _, first, index = np.unique(np.round(flat / 1e-7), axis=0, return_index=True, return_inverse=True)
            quad = index.reshape(-1, 4)
            three = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
            whole = (three[:, 0] != three[:, 1]) & (three[:, 1] != three[:, 2]) & (three[:, 2] != three[:, 0])
            corners.append(flat[first])
            faces.append(three[whole] + count)
            owner.append(np.full(int(whole.sum()), which))
            count += len(first)
        return cls(np.concatenate(corners), np.concatenate(faces), np.concatenate(owner))

    def document(self, decimals: int = 1) -> dict[str, Json]:
        """``x, y, z`` [mm] of the corners, and ``i, j, k`` of the triangles."""
        points = np.round(1e3 * self.corners, decimals)
        return {
            **{name: points[:, axis].tolist() for axis, name in enumerate("xyz")},
            **{name: self.faces[:, axis].tolist() for axis, name in enumerate("ijk")},
        }


def solids_document(solids: Sequence[Solid]) -> dict[str, Json]:
    """Solids as one mesh: with its triangles the frame of each corner, and of which part each triangle is."""
    found = Triangles.of([solid.faces for solid in solids])
    frame = np.zeros(len(found.corners), dtype=int)
    frame[found.faces] = np.array([solid.frame for solid in solids])[found.owner][:, None]
    parts = [{"name": solid.name, "role": solid.role} for solid in solids]
    return {**found.document(), "frame": frame.tolist(), "part": found.owner.tolist(), "parts": parts}


def arrow() -> Triangles:
    """An arrow of length 1 along z from the origin: a shaft and a cone."""
    neck, tip = np.array([0.0, 0.0, 0.74]), np.array([0.0, 0.0, 1.0])
    return Triangles.of(
        [cylinder_facets(np.zeros(3), neck, _SHAFT_RADIUS), tapered_facets(neck, tip, _HEAD_RADIUS, 0.0)]
    )


def ball() -> Triangles:
    """A ball of radius 1 about the origin; what flattens it to a disc makes it the region of a planar arm."""
    pole = np.array([0.0, 0.0, 1e-9])
    return Triangles.of([tapered_facets(-pole, pole, 1.0, 1.0)])


VIEWED_ROWS = 200
"""Of a table: more postures hide each other."""
_MAX_REGION_SHARE = 0.4  # of the extent: an enlarged region is no longer than this
_VIEW_TURNS_DEG = -62.0, 62.0, -100.0, 100.0, -30.0, 30.0  # deg off where the arm reaches to, the best view first


@dataclass(frozen=True)
class Mark:
    """Words at a joint, at ``base`` or at ``tool``, which are shown in colour."""

    owner: str
    text: str


@dataclass(frozen=True, eq=False)
class ShownPosture:
    """One posture of a view.

    Args:
        key: by which rows of tables name it; ``label`` is read by people.
        q: (n,) [rad or m].
        facts: pairs of a label and a value.
        spread: of the tool there; None: no region is drawn.
        target: where the tool point should be; None: nothing is drawn of it.
        shares: of the owners of the sources (a joint, ``base``, ``tool``) in the variance that counts.
        marks: words at joints.
        value: by which the point is coloured where the view has values.
    """

    key: str
    label: str
    q: Array
    facts: tuple[tuple[str, str], ...] = ()
    spread: Spread | None = None
    target: TargetGeometry | None = None
    shares: tuple[tuple[str, float], ...] = ()
    marks: tuple[Mark, ...] = ()
    value: float | None = None


@dataclass(frozen=True, eq=False)
class ArmView(View):
    """An arm in at least one posture.

    Args:
        robot: whose links, joints and limits are drawn.
        postures: the first one is shown at first.
        choice: what the postures are, as the label of the list to choose from.
        scene: the obstacles; None: nothing.
        points: whether the tool points are marked, to be clicked; ``line`` whether they are joined in their order.
        values: what colours the points, with its unit.
    """

    robot: Robot
    postures: tuple[ShownPosture, ...]
    choice: str
    scene: Scene | None = None
    points: bool = False
    line: bool = False
    values: str = ""

    @property
    def keys(self) -> frozenset[str]:
        """Of all postures."""
        return frozenset(posture.key for posture in self.postures)

    def document(self) -> dict[str, Json]:
        """Plain numbers: lengths in mm, frames as ``R | t`` row by row."""
        around = self._around
        # The floor goes on beyond what is drawn of it.
        low, high = _bounds(np.concatenate([self._points, *(_corners(s) for s in around if s.role != "floor")]))
        return {
            "colours": COLOURS,
            "arm": solids_document(self._arm.solids),
            "joints": [self._joint(k) for k in range(self.robot.n)],
            "around": [{"name": s.name, "role": s.role, **Triangles.of([s.faces]).document()} for s in around],
            "shapes": {"ball": ball().document(4), "arrow": arrow().document(4)},
            "postures": [self._posture(posture) for posture in self.postures],
            "region": self._regions[0].label if self._regions else "",
            "box": self._box,
            "points": self.points,
            "line": self.line,
            "values": self.values,
            "planar": self._planar,
            "low": np.round(1e3 * low).tolist(),
            "high": np.round(1e3 * high).tolist(),
            "eye": self._eye,
        }

    @cached_property
    def _arm(self) -> ArmSolids:
        """The bodies of the arm, each in the frame that it moves with."""
        return ArmSolids(self.robot)

    @cached_property
    def _frames(self) -> tuple[Array, ...]:
        """Of each posture, (n + 2, 4, 4) the frames of base, links and tool, world [m]."""
        return tuple(self._arm.frames(posture.q) for posture in self.postures)

    @cached_property
    def _points(self) -> Array:
        """(k, 3) corners of the arm in all postures, not all of them where there are many [m]."""
        found = []
        for frames in self._frames:
            for solid in self._arm.solids:
                corners = solid.placed(frames).faces.reshape(-1, 3)
                # About 800 corners tell the extent of an arm.
                found.append(corners[:: max(1, len(self.postures) * len(corners) // 800)])
        return np.concatenate(found)

    @cached_property
    def _extent(self) -> float:
        """The largest edge of the box around the arm in its first posture [m]."""
        frames = self._frames[0]
        return extent_of(np.concatenate([solid.placed(frames).faces.reshape(-1, 3) for solid in self._arm.solids]))

    @cached_property
    def _around(self) -> tuple[Solid, ...]:
        obstacles = () if self.scene is None else obstacles_near(self.scene, self._points)
        height = None if self.scene is None else self.scene.floor_height
        floor = None if self._planar else floor_under(self._points, obstacles, height)
        return obstacles if floor is None else (*obstacles, floor)

    @property
    def _planar(self) -> bool:
        spread = self.postures[0].spread
        return spread is not None and len(spread.basis) == 2

    @cached_property
    def _regions(self) -> tuple[ErrorRegion, ...]:
        spreads = [posture.spread for posture in self.postures if posture.spread is not None]
        sizes = [float(spread.region(0.95)[-1]) for spread in spreads]
        if not sizes:
            return ()
        factor = enlargement(sizes[0], self._extent)
        if max(sizes) * factor > _MAX_REGION_SHARE * self._extent:
            factor = max(1.0, enlargement(max(sizes), _MAX_REGION_SHARE / 0.16 * self._extent))
        return tuple(ErrorRegion.of(spread, factor) for spread in spreads)

    def _posture(self, posture: ShownPosture) -> dict[str, Json]:
        """One posture as plain numbers: frames, region, arrow of the direction, ring, target that is missed, shares,
        marks."""
        k = self.postures.index(posture)
        region = None
        if posture.spread is not None:
            region = self._regions[sum(p.spread is not None for p in self.postures[:k])]
        target, tool = posture.target, self._frames[k][-1][:3, 3]
        ring = None if target is None or region is None else target.ring(region.factor, tool, self._extent)
        arrow = None if target is None else ARROW_SHARE * self._extent * frame_along(target.direction)
        return {
            "key": posture.key,
            "label": posture.label,
            "facts": [*posture.facts, *self._joint_facts(posture.q)],
            "frames": [_affine(T[:3, :3], T[:3, 3]) for T in self._frames[k]],
            "region": None if region is None else _affine(region.factor * _square(region.semi_axes), region.center),
            "arrow": None if arrow is None else _affine(arrow, tool),
            "ring": None if ring is None else {"axes": _affine(ring.axes, ring.center), "label": ring.label},
            "missed": (1e3 * target.lower).round(1).tolist() if target is not None and target.missed(tool) else None,
            "shares": [[owner, round(share, 4)] for owner, share in posture.shares],
            "marks": [[mark.owner, mark.text] for mark in posture.marks],
            "value": posture.value,
        }

    def _joint_facts(self, q: Array) -> list[tuple[str, str]]:
        """Name and value [deg or mm] of each joint at q (n,) [rad or m]."""
        units = [joint_unit(joint.type) for joint in self.robot.joints]
        values = zip(self.robot.joint_names, units, q, strict=True)
        return [(name, f"{fixed(value * factor)} {unit}") for name, (unit, factor), value in values]

    def _joint(self, k: int) -> dict[str, Json]:
        """Name, frame and middle (3,) [mm] of joint k in that frame."""
        joint = self._arm.joints[k]
        return {"name": joint.name, "frame": joint.frame, "middle": (1e3 * joint.middle).round(1).tolist()}

    @property
    def _box(self) -> list[list[float]] | None:
        """(2, 3) corners of the box for the target [mm]; None where there is none."""
        target = self.postures[0].target
        if target is None or target.kind != "region":
            return None
        return np.round(1e3 * np.array([target.lower, target.upper]), 1).tolist()  # type: ignore[no-any-return]

    @property
    def _eye(self) -> list[float]:
        """(3,) the direction to the viewer: from the side of the arm and a little from above; planar arms from above
        their plane."""
        if self._planar:
            spread = self.postures[0].spread
            assert spread is not None
            # A little off the normal: what is up on the screen is then up in the plane.
            return (np.cross(*spread.basis) - 0.01 * spread.basis[1]).round(3).tolist()  # type: ignore[no-any-return]
        origins = self._frames[0][:, :3, 3]
        out = (origins - origins[0])[:, :2]
        far = out[np.argmax(np.linalg.norm(out, axis=1))]
        ahead = math.atan2(far[1], far[0])
        azimuth = min((ahead + math.radians(turn) for turn in _VIEW_TURNS_DEG), key=self._hidden)
        return [round(0.9 * math.cos(azimuth), 3), round(0.9 * math.sin(azimuth), 3), 0.42]

    def _hidden(self, azimuth: float) -> float:
        """How far obstacles that are as high as the arm's middle reach in front of it, seen from there [m]."""
        middle = (self._points.min(axis=0) + self._points.max(axis=0)) / 2
        towards = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        tall = [_corners(s) for s in self._around if s.role == "obstacle" and _corners(s)[:, 2].max() > middle[2]]
        return round(sum(max(float(np.max((points - middle) @ towards)), 0.0) for points in tall), 3)


def _corners(solid: Solid) -> Array:
    """The corners (k, 3) [m] of a solid."""
    return solid.faces.reshape(-1, 3)


def _bounds(points: Array) -> tuple[Array, Array]:
    """The corners (3,) and (3,) [m] of the box about points (k, 3), with a margin of 4 % of its longest edge."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * float((high - low).max())
    return low - margin, high + margin


def _affine(A: Array, t: Array) -> list[float]:
    """``A | t`` row by row, (12,): A as it is, t in mm."""
    rows = np.column_stack([np.round(A, 5), np.round(1e3 * t, 2)])
    return rows.ravel().tolist()


def _square(semi_axes: Array) -> Array:
    """Semi-axes (3, m) as the columns of a (3, 3) matrix; those that are missing are zero."""
    return np.hstack([semi_axes, np.zeros((3, 3 - semi_axes.shape[1]))])
