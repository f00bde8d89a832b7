"""``ArmView``: an arm in several postures to choose from, with its target and surroundings, as plotly.js draws them.

Inside everything is in m and rad; the document for the page has mm and frames as twelve numbers ``R | t``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.collision.facets import cylinder_facets, tapered_facets
from posture_opt.numerics import Array, Codes, Json
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
from posture_opt.statements.notation import joint_value, length_unit

if TYPE_CHECKING:
    from posture_opt import Robot, Spread
    from posture_opt.collision.scene import Scene


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
    return Triangles.of([cylinder_facets(np.zeros(3), neck, 0.028), tapered_facets(neck, tip, 0.075, 0.0)])


def ball() -> Triangles:
    """A ball of radius 1 about the origin; what flattens it to a disc makes it the region of a planar arm."""
    pole = np.array([0.0, 0.0, 1e-9])
    return Triangles.of([tapered_facets(-pole, pole, 1.0, 1.0)])


VIEWED_ROWS = 200
"""Of a table: more postures hide each other."""
_MAX_REGION_SHARE = 0.4  # of the extent: an enlarged region is no longer than this


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
        marks: words at joints, at ``base`` or ``tool``, which are shown in colour.
        value: by which the point is coloured where the view has values.
    """

    key: str
    label: str
    q: Array
    facts: tuple[tuple[str, str], ...] = ()
    spread: Spread | None = None
    target: TargetGeometry | None = None
    shares: tuple[tuple[str, float], ...] = ()
    marks: tuple[tuple[str, str], ...] = ()
    value: float | None = None


@dataclass(frozen=True, eq=False)
class ArmView:
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

    @classmethod
    def coloured(
        cls, problem: Any, choice: str, sized: Sequence[tuple[ShownPosture, float]], what: str, *first: ShownPosture
    ) -> ArmView:
        """Postures with lengths [m] that colour their points, ``what`` they are; ``first`` come without colours."""
        unit, factor = length_unit([size for _, size in sized])
        coloured = (replace(posture, value=round(factor * size, 5)) for posture, size in sized)
        scene, values = getattr(problem, "scene", None), f"{what} [{unit}]"
        return cls(problem.robot, (*first, *coloured), choice, scene, points=True, values=values)

    @property
    def keys(self) -> frozenset[str]:
        """Rows of tables with such a key show a posture."""
        return frozenset(posture.key for posture in self.postures)

    def document(self) -> dict[str, Json]:
        """Plain numbers: lengths in mm, frames as ``R | t`` row by row."""
        around = self._around
        # The floor goes on beyond what is drawn of it.
        points = np.concatenate([self._points, *(s.corners for s in around if s.role != "floor")])
        low, high, margin = points.min(axis=0), points.max(axis=0), 0.04 * float(np.ptp(points, axis=0).max())
        target, joints = self.postures[0].target, self._arm.joints
        box = None if target is None or target.kind != "region" else np.array([target.lower, target.upper])
        return {
            "colours": COLOURS,
            "arm": solids_document(self._arm.solids),
            "joints": [{"name": j.name, "frame": j.frame, "middle": _mm(j.middle)} for j in joints],
            "around": [{"name": s.name, "role": s.role, **Triangles.of([s.faces]).document()} for s in around],
            "shapes": {"ball": ball().document(4), "arrow": arrow().document(4)},
            "postures": [self._posture(posture) for posture in self.postures],
            "region": self._regions[0].label if self._regions else "",
            "box": None if box is None else _mm(box),
            "points": self.points,
            "line": self.line,
            "values": self.values,
            "planar": self._planar,
            "low": np.round(1e3 * (low - margin)).tolist(),
            "high": np.round(1e3 * (high + margin)).tolist(),
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
                corners = solid.placed(frames).corners
                # About 800 corners tell the extent of an arm.
                found.append(corners[:: max(1, len(self.postures) * len(corners) // 800)])
        return np.concatenate(found)

    @cached_property
    def _extent(self) -> float:
        """The largest edge of the box around the arm in its first posture [m]."""
        frames = self._frames[0]
        return extent_of(np.concatenate([solid.placed(frames).corners for solid in self._arm.solids]))

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
        # Semi-axes that are missing are zero.
        axes = None if region is None else np.pad(region.semi_axes, ((0, 0), (0, 3 - region.semi_axes.shape[1])))
        joints = self.robot.joints
        arrow = None if target is None else ARROW_SHARE * self._extent * frame_along(target.direction)
        return {
            "key": posture.key,
            "label": posture.label,
            "facts": [
                *posture.facts,
                *((j.name, joint_value(v, j.type)) for j, v in zip(joints, posture.q, strict=True)),
            ],
            "frames": [_affine(T[:3, :3], T[:3, 3]) for T in self._frames[k]],
            "region": None if region is None or axes is None else _affine(region.factor * axes, region.center),
            "arrow": None if arrow is None else _affine(arrow, tool),
            "ring": None if ring is None else {"axes": _affine(ring.axes, ring.center), "label": ring.label},
            "missed": _mm(target.lower) if target is not None and target.missed(tool) else None,
            "shares": [[owner, round(share, 4)] for owner, share in posture.shares],
            "marks": list(map(list, posture.marks)),
            "value": posture.value,
        }

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
        middle = (self._points.min(axis=0) + self._points.max(axis=0)) / 2
        solids = [s.corners for s in self._around if s.role == "obstacle"]
        tall = [corners for corners in solids if corners[:, 2].max() > middle[2]]

        def hidden(azimuth: float) -> float:
            """How far obstacles as high as the arm's middle reach in front of it, seen from there [m]."""
            towards = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            return round(sum(max(float(np.max((points - middle) @ towards)), 0.0) for points in tall), 3)

        # Turns off where the arm reaches to, the best view first [deg].
        turns = np.radians([-62.0, 62.0, -100.0, 100.0, -30.0, 30.0]).tolist()
        azimuth = min((ahead + turn for turn in turns), key=hidden)
        return [round(0.9 * math.cos(azimuth), 3), round(0.9 * math.sin(azimuth), 3), 0.42]


def _affine(A: Array, t: Array) -> list[float]:
    """``A | t`` row by row, (12,): A as it is, t in mm."""
    rows: list[float] = np.column_stack([np.round(A, 5), np.round(1e3 * t, 2)]).ravel().tolist()
    return rows


def _mm(points: Array) -> Json:
    """Points [m] in mm, to 0.1 mm."""
    found: Json = (1e3 * points).round(1).tolist()
    return found
