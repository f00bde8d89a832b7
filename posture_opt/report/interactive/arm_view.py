"""``ArmView``: an arm in several postures to choose from, with what is asked of its tool point and what is around.

Inside everything is in m and rad; the document for the page has mm and frames as twelve numbers ``R | t``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.report.interactive.triangles import Triangles, arrow, ball, solids_document
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
    from posture_opt.collision.scene import Scene
    from posture_opt.robot.robot import Robot
    from posture_opt.uncertainty.spread.spread import Spread

VIEWED_ROWS = 200
"""Of a table: more postures hide each other."""
_MAX_REGION_SHARE = 0.4  # of the extent: an enlarged region is no longer than this
_VIEW_TURNS_DEG = -62.0, 62.0, -100.0, 100.0, -30.0, 30.0  # deg off where the arm reaches to, the best view first
_MAX_CORNERS = 800  # corners of an arm are looked at for its extent


@dataclass(frozen=True)
class Mark:
    """Words at a joint, at ``base`` or at ``tool``, which are shown in colour.

    Args:
        owner: name of the joint, ``base`` or ``tool``.
        text: one line or more.
    """

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
                found.append(corners[:: max(1, len(self.postures) * len(corners) // _MAX_CORNERS)])
        return np.concatenate(found)

    @cached_property
    def _extent(self) -> float:
        """The largest edge of the box around the arm in its first posture [m]."""
        frames = self._frames[0]
        return extent_of(np.concatenate([solid.placed(frames).faces.reshape(-1, 3) for solid in self._arm.solids]))

    @cached_property
    def _around(self) -> tuple[Solid, ...]:
        """Obstacles near the arm, and a floor where none of them is one; a planar arm has no floor."""
        obstacles = () if self.scene is None else obstacles_near(self.scene, self._points)
        height = None if self.scene is None else self.scene.floor_height
        floor = None if self._planar else floor_under(self._points, obstacles, height)
        return obstacles if floor is None else (*obstacles, floor)

    @property
    def _planar(self) -> bool:
        """Whether the arm moves in a plane, as the spread of its first posture says."""
        spread = self.postures[0].spread
        return spread is not None and len(spread.basis) == 2

    @cached_property
    def _regions(self) -> tuple[ErrorRegion, ...]:
        """Of the postures that have one, all enlarged alike, so that their sizes compare."""
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
        marks.

        What a posture has not is None. The region is the map of a unit ball, enlarged; ``missed`` is the target [mm]
        where the tool point is more than 0.1 mm off it.
        """
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
        their plane.
        """
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
