"""The shape of a URDF arm: capsules about the ``<collision>`` elements of its links.

What is fixed to a link belongs to it: all that does not move against the base to ``base``, the rest to the joint that
carries it, links behind the tip included.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from posture_opt.errors import listed
from posture_opt.numerics import TURN, Array
from posture_opt.robot.capsule_fit import Edges, fitted_capsules
from posture_opt.robot.meshes import UnreadMeshError, located_mesh, read_mesh
from posture_opt.robot.robot import BASE, Capsule, moved
from posture_opt.robot.urdf_tree import Collision, UrdfTree

_RIM_CORNERS = 48  # Corners of the polygon about a cylinder's rim: it is 0.2 % wider than the rim
_COINCIDENCE_M = 1e-6  # Two lengths or places in a file that differ by less are meant to be one


@dataclass(frozen=True)
class Carried:
    """The link that a joint carries."""

    joint: str  # name of the joint, or base for the base link
    link: str  # name of the link
    T_joint_link: Array  # (4, 4) the link in the frame behind the joint, lengths in [m]


class UrdfShape(NamedTuple):
    """The shape that a URDF states."""

    capsules: tuple[Capsule, ...]  # [m], in the frame behind each joint
    notes: tuple[str, ...]  # one for each reason why a shape is missing
    unshaped: tuple[str, ...]  # names of the links that have none; bare the joints that carry them
    bare: tuple[str, ...]


def urdf_shape(tree: UrdfTree, carried: Sequence[Carried], file: Path) -> UrdfShape:
    """The capsules of all links, and notes on links that have none or not all. tree: links with their ``<collision>``
    elements."""
    capsules: list[Capsule] = []
    unread: dict[str, list[str]] = {}
    bare: list[str] = []
    joints: list[str] = []
    for body in carried:
        before, missed_before = len(capsules), sum(map(len, unread.values()))
        for link, T_link_other in tree.rigid(body.link):
            try:
                found = [*_link_capsules(tree.collisions.get(link, ()), file)]
            except UnreadMeshError as reason:
                unread.setdefault(str(reason), []).append(link)
                continue
            T = body.T_joint_link @ T_link_other
            capsules += [moved(replace(capsule, joint=body.joint), T) for capsule in found]
        missed = [link for links in unread.values() for link in links]
        if len(capsules) == before and body.joint != BASE and body.link not in missed:
            bare.append(body.link)
        if bare[-1:] == [body.link] or len(missed) > missed_before:
            joints.append(body.joint)
    notes = [f"no shape of {listed(links)}: {reason}" for reason, links in unread.items()]
    if bare and capsules:
        notes.append(f"no shape of {listed(bare)}: the file states no <collision>")
    unshaped = [link for links in unread.values() for link in links] + bare
    return UrdfShape(tuple(capsules), (*notes, *_unchained_note(tree, carried)), tuple(unshaped), tuple(joints))


def _unchained_note(tree: UrdfTree, carried: Sequence[Carried]) -> tuple[str, ...]:
    known = {link for body in carried for link, _ in tree.rigid(body.link)}
    unchained = [
        joint.child
        for joint in tree.joints
        if joint.parent in known and joint.child not in known and tree.collisions.get(joint.child)
    ]
    return (f"not in the shape, as they move apart from the chain: {listed(unchained)}",) if unchained else ()


def _link_capsules(collisions: Sequence[Collision], file: Path) -> Iterator[Capsule]:
    """Capsules [m] in the frame of the link; a cylinder with a ball at both ends is one capsule."""
    balls = [collision for collision in collisions if collision.kind == "sphere"]
    used: set[int] = set()
    for collision in collisions:
        if collision.kind == "cylinder" and (ends := _end_spheres(collision, balls)):
            used |= {id(ball) for ball in ends}
            yield _axial_capsule(collision, collision.size[0], collision.size[1])
        elif collision.kind == "capsule":
            yield _axial_capsule(collision, collision.size[0], collision.size[1])
        elif collision.kind != "sphere":
            yield from (moved(found, collision.origin) for found in _fitted_body(collision, file))
    yield from (_axial_capsule(ball, ball.size[0], 0.0) for ball in balls if id(ball) not in used)


def _end_spheres(cylinder: Collision, balls: Sequence[Collision]) -> list[Collision]:
    radius, length = cylinder.size
    found = []
    for sign in (-1, 1):
        end = (cylinder.origin @ [0.0, 0.0, sign * length / 2, 1.0])[:3]
        near = (
            b
            for b in balls
            if abs(b.size[0] - radius) < _COINCIDENCE_M and np.linalg.norm(b.origin[:3, 3] - end) < _COINCIDENCE_M
        )
        found += [next(near, None)]
    return [ball for ball in found if ball is not None] if None not in found else []


def _axial_capsule(collision: Collision, radius: float, length: float) -> Capsule:
    """A capsule of radius and length of its segment [m] along z of the collision's frame, in the frame of the link."""
    return moved(Capsule(BASE, (0.0, 0.0, -length / 2), (0.0, 0.0, length / 2), radius), collision.origin)


def _fitted_body(collision: Collision, file: Path) -> tuple[Capsule, ...]:
    """Capsules about a box, a cylinder or a mesh in its own frame."""
    if collision.kind != "mesh":
        return _fitted_solid(collision.kind, collision.size)
    path = located_mesh(collision.file, file)
    status = path.stat()
    return _fitted_mesh(path, collision.size, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=256)
def _fitted_solid(kind: str, size: tuple[float, ...]) -> tuple[Capsule, ...]:
    return tuple(fitted_capsules(_body_edges(kind, size), BASE))


@lru_cache(maxsize=256)
def _fitted_mesh(path: Path, scale: tuple[float, ...], _changed: int, _size: int) -> tuple[Capsule, ...]:
    return tuple(fitted_capsules(read_mesh(path, scale), BASE))


def _body_edges(kind: str, size: tuple[float, ...]) -> Edges:
    """The edges [m] of a box or a cylinder in its own frame; the cylinder as a prism about its rim."""
    if kind == "box":
        x, y = size[0] / 2, size[1] / 2
        rim, height = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), size[2]
    else:
        turn = TURN * np.arange(_RIM_CORNERS) / _RIM_CORNERS
        rim, height = np.column_stack([np.cos(turn), np.sin(turn)]) * size[0], size[1]
        rim /= math.cos(math.pi / _RIM_CORNERS)
    low, high = (np.column_stack([rim, np.full(len(rim), z)]) for z in (-height / 2, height / 2))
    tails = np.vstack([low, high, low])
    return Edges(tails, np.vstack([np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high]))
