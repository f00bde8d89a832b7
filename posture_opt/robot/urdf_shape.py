"""The shape of a URDF arm: capsules about the ``<collision>`` elements of its links.

What is fixed to a link belongs to it: all that does not move against the base to ``base``, the rest to the joint that
carries it, what hangs behind the tip included.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from posture_opt.errors import listed
from posture_opt.numerics import Array
from posture_opt.robot.capsule_fit import Edges, fitted_capsules
from posture_opt.robot.meshes import UnreadMeshError, located_mesh, read_mesh
from posture_opt.robot.shape import BASE, Capsule, Point
from posture_opt.robot.urdf_tree import Collision, UrdfTree

_CORNERS = 48  # of the polygon about a cylinder's rim: 0.2 % wider than the rim
_SAME = 1e-6  # m: two lengths or places in a file that are meant to be one


@dataclass(frozen=True)
class Carried:
    """The link that a joint carries, and where it is in the frame behind the joint; of ``base`` the base link."""

    joint: str
    link: str
    T_joint_link: Array


def urdf_shape(tree: UrdfTree, carried: Sequence[Carried], file: Path) -> tuple[tuple[Capsule, ...], tuple[str, ...]]:
    """The capsules of all links, and what is to be known of links that have none or not all."""
    capsules: list[Capsule] = []
    unread: dict[str, list[str]] = {}
    for body in carried:
        for link, T_link_other in tree.rigid(body.link):
            try:
                found = [*_of_link(tree.collisions.get(link, ()), file)]
            except UnreadMeshError as reason:
                unread.setdefault(str(reason), []).append(link)
                continue
            T = body.T_joint_link @ T_link_other
            capsules += [moved(replace(capsule, joint=body.joint), T) for capsule in found]
    notes = [f"no shape of {listed(links)}: {reason}" for reason, links in unread.items()]
    return tuple(capsules), (*notes, *_left_out(tree, carried))


def _left_out(tree: UrdfTree, carried: Sequence[Carried]) -> tuple[str, ...]:
    """A note on links with a shape that hang on the arm by joints that are not of the chain, as fingers do."""
    known = {link for body in carried for link, _ in tree.rigid(body.link)}
    beside = [
        joint.child
        for joint in tree.joints
        if joint.parent in known and joint.child not in known and tree.collisions.get(joint.child)
    ]
    return (f"not in the shape, as they move beside the chain: {listed(beside)}",) if beside else ()


def _of_link(collisions: Sequence[Collision], file: Path) -> Iterator[Capsule]:
    """Capsules in the frame of the link."""
    balls = [collision for collision in collisions if collision.kind == "sphere"]
    used: set[int] = set()
    for collision in collisions:
        if collision.kind == "cylinder" and (ends := _rounded(collision, balls)):
            used |= {id(ball) for ball in ends}
            yield _segment(collision, collision.size[0], collision.size[1])
        elif collision.kind == "capsule":
            yield _segment(collision, collision.size[0], collision.size[1])
        elif collision.kind != "sphere":
            yield from (moved(found, collision.origin) for found in _fitted(collision, file))
    yield from (_segment(ball, ball.size[0], 0.0) for ball in balls if id(ball) not in used)


def _rounded(cylinder: Collision, balls: Sequence[Collision]) -> list[Collision]:
    """The two balls that make a capsule of a cylinder, as self-collision models have it; nothing without both."""
    radius, length = cylinder.size
    found = []
    for sign in (-1, 1):
        end = (cylinder.origin @ [0.0, 0.0, sign * length / 2, 1.0])[:3]
        near = (b for b in balls if abs(b.size[0] - radius) < _SAME and np.linalg.norm(b.origin[:3, 3] - end) < _SAME)
        found += [next(near, None)]
    return [ball for ball in found if ball is not None] if None not in found else []


def _segment(collision: Collision, radius: float, length: float) -> Capsule:
    """A capsule along z of the collision's frame, in the frame of the link."""
    return moved(Capsule(BASE, (0.0, 0.0, -length / 2), (0.0, 0.0, length / 2), radius), collision.origin)


def _fitted(collision: Collision, file: Path) -> tuple[Capsule, ...]:
    """Capsules about a box, a cylinder or a mesh in its own frame."""
    if collision.kind != "mesh":
        return tuple(fitted_capsules(_body(collision), BASE))
    path = located_mesh(collision.file, file)
    status = path.stat()
    return _fitted_mesh(path, collision.size, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=256)
def _fitted_mesh(path: Path, scale: tuple[float, ...], _changed: int, _size: int) -> tuple[Capsule, ...]:
    """Fitted once for all problems of an arm: a fine mesh takes a second."""
    return tuple(fitted_capsules(read_mesh(path, scale), BASE))


def _body(collision: Collision) -> Edges:
    """The edges of a box or a cylinder in its own frame."""
    if collision.kind == "box":
        x, y = collision.size[0] / 2, collision.size[1] / 2
        rim, height = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), collision.size[2]
    else:
        turn = 2 * math.pi * np.arange(_CORNERS) / _CORNERS
        rim, height = np.column_stack([np.cos(turn), np.sin(turn)]) * collision.size[0], collision.size[1]
        rim /= math.cos(math.pi / _CORNERS)
    low, high = (np.column_stack([rim, np.full(len(rim), z)]) for z in (-height / 2, height / 2))
    tails = np.vstack([low, high, low])
    return Edges(tails, np.vstack([np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high]))


def moved(capsule: Capsule, T: Array) -> Capsule:
    """The capsule in another frame, ``T`` (4, 4) of its own seen from there."""
    return replace(capsule, start=_point(T, capsule.start), end=_point(T, capsule.end))


def _point(T: Array, point: Point) -> Point:
    x, y, z = (T[:3, :3] @ np.array(point) + T[:3, 3]).tolist()
    return x, y, z
