"""The shape of a URDF arm: capsules about the ``<collision>`` elements of its links.

What is fixed to a link belongs to it: all that does not move against the base to ``base``, the rest to the joint that
carries it, links behind the tip included.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from posture_opt.errors import listed
from posture_opt.numerics import TURN, Array
from posture_opt.robot.meshes import MAX_FACES, UnreadMeshError, load_mesh, located_mesh, usable
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
    """The shape that a URDF states, as a `Robot` has it."""

    shape: tuple[Capsule, ...]  # [m], in the frame behind each joint
    shape_notes: tuple[str, ...]  # one for each reason why a shape is missing
    unshaped: tuple[str, ...]  # names of the links that have none; bare_joints those that carry them
    bare_joints: tuple[str, ...]


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
    found: list[Collision] = []
    for sign in (-1, 1):
        end = (cylinder.origin @ [0.0, 0.0, sign * length / 2, 1.0])[:3]
        alike = [ball for ball in balls if abs(ball.size[0] - radius) < _COINCIDENCE_M]
        found += [ball for ball in alike if np.linalg.norm(ball.origin[:3, 3] - end) < _COINCIDENCE_M][:1]
    return found if len(found) == 2 else []


def _axial_capsule(collision: Collision, radius: float, length: float) -> Capsule:
    """A capsule of radius and length of its segment [m] along z of the collision's frame, in the frame of the link."""
    return moved(Capsule(BASE, (0.0, 0.0, -length / 2), (0.0, 0.0, length / 2), radius), collision.origin)


def _fitted_body(collision: Collision, file: Path) -> tuple[Capsule, ...]:
    """Capsules about a box, a cylinder or a mesh in its own frame."""
    if collision.kind != "mesh":
        return _fitted(collision.kind, collision.size)
    path = located_mesh(collision.file, file)
    status = path.stat()
    return _fitted(path, collision.size, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=512)
def _fitted(body: str | Path, size: tuple[float, ...], *_version: int) -> tuple[Capsule, ...]:
    """Capsules about a body of a kind, or about the mesh of a file, kept for each version of the file."""
    edges = read_mesh(body, size) if isinstance(body, Path) else _body_edges(body, size)
    return tuple(fitted_capsules(edges, BASE))


def read_mesh(path: Path, scale: tuple[float, ...]) -> Edges:
    """The edges of a mesh, its lengths times ``scale`` (3,), in the frame of the ``<collision>`` element [m]. Read once
    for each version of the file (time and size of its last change)."""
    mesh = load_mesh(path)
    vertices = np.asarray(mesh.vertices, dtype=float) * np.array(scale)
    edges = np.asarray(mesh.edges_unique)
    if not len(edges) or not usable(vertices):
        raise UnreadMeshError(f"mesh {path.name} is empty or broken")
    if len(mesh.faces) > MAX_FACES:
        return Edges.about(vertices)
    return Edges(vertices[edges[:, 0]], vertices[edges[:, 1]])


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


# A further capsule must save this factor of volume: each one more is checked against all others in every posture
VOLUME_FACTOR = 1.15
_DIRECTION_COUNT = 80  # Directions whose outermost points stand for a body while its capsule is searched for
# Values of x[6] to start from: the radius is the least one times 1 + x[6]², see `_enclosing_capsule`
_START_EXCESSES = (0.0, 0.25)


@dataclass(frozen=True)
class Edges:
    """Edges of a surface; of a convex body those between its corners are enough."""

    tails: Array  # tails, heads: (m, 3), (m, 3) both ends of each edge [m], in the frame of the body
    heads: Array

    @classmethod
    def about(cls, points: Array) -> Edges:
        """The edges of the convex hull of points (k, 3) [m] that do not lie in one plane."""
        from scipy.spatial import ConvexHull

        faces = ConvexHull(points, qhull_options="QJ").simplices
        return cls(points[faces].reshape(-1, 3), points[np.roll(faces, -1, axis=1)].reshape(-1, 3))

    def slices(self, axis: Array, count: int) -> list[Array]:
        """Points (k, 3) [m] of each slice across an axis: corners in it, and where edges cross the planes on both
        sides. The hull of the points of neighbouring slices holds all of the surface there. axis: (3,) unit vector,
        frame of the body."""
        a, b = self.tails @ axis, self.heads @ axis
        planes = np.linspace(min(a.min(), b.min()), max(a.max(), b.max()), count + 1)
        points, heights = [self.tails, self.heads], [a, b]
        for plane in planes[1:-1]:
            crosses = (a - plane) * (b - plane) < 0
            t = ((plane - a[crosses]) / (b - a)[crosses])[:, None]
            points.append(self.tails[crosses] + t * (self.heads - self.tails)[crosses])
            heights.append(np.full(len(t), plane))
        every, height = np.vstack(points), np.concatenate(heights)
        return [every[(height >= low) & (height <= high)] for low, high in itertools.pairwise(planes)]


# Capsules for one body: a link is a beam between two housings.
def fitted_capsules(body: Edges, joint: str, most: int = 3) -> tuple[Capsule, ...]:
    """Up to ``most`` capsules that together contain the surface of a body, frame behind ``joint``, to rounding. All
    ways to cut its slices into runs are compared by capsules along main axes; the runs of the best one then get their
    smallest capsules, if these are together smaller than the one of the whole."""
    ends = np.vstack([body.tails, body.heads])
    one = [smallest_capsule(ends, joint)]
    if most == 1:
        return tuple(one)
    longest = max(_main_axes(ends), key=lambda axis: float(np.ptp(ends @ axis)))

    def cost(capsules: Sequence[Capsule]) -> float:
        return sum(capsule.volume for capsule in capsules) * VOLUME_FACTOR ** len(capsules)

    # Slices of a body along its longest axis: 9 leave 36 ways to cut it into at most three runs.
    runs = _cheapest_runs(body.slices(longest, 9), most)
    best = min(one, [smallest_capsule(points, joint) for points in runs], key=cost)
    return tuple(best)


def _cheapest_runs(slices: list[Array], most: int) -> list[Array]:
    """The points (k, 3) of each run of slices, cut where their capsules cost least together."""
    count = len(slices)
    seen = [_outermost_points(points) for points in slices]
    volume = {(i, j): _least_volume(np.vstack(seen[i:j])) for i, j in itertools.combinations(range(count + 1), 2)}
    ways = [
        list(itertools.pairwise((0, *cuts, count)))
        for k in range(1, most)
        for cuts in itertools.combinations(range(1, count), k)
    ]
    best = min(ways, key=lambda way: sum(volume[run] for run in way) * VOLUME_FACTOR ** len(way))
    return [points for i, j in best if len(points := np.vstack(slices[i:j]))]


def _least_volume(points: Array) -> float:
    """The least volume [m³] of a capsule about points (k, 3) whose axis is one of their main axes; 0 without points."""
    return min((_capsule_volume(start, points) for start in _start_variables(points)), default=0.0)


def smallest_capsule(points: Array, joint: str) -> Capsule:
    """The capsule of least volume about points (k, 3) [m], frame behind ``joint``. Its axis is sought by the simplex
    method from the main axes about the outermost points; radius and ends follow from all points, so it contains them
    and their hull to rounding."""
    from scipy.optimize import minimize

    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    scaled = (points - middle) / size
    outer = _outermost_points(scaled)
    starts = sorted(_start_variables(outer), key=lambda start: _capsule_volume(start, outer))[:2]
    options = {"xatol": 1e-3, "fatol": 1e-5, "maxiter": 400}
    found = [minimize(_capsule_volume, start, (outer,), "Nelder-Mead", options=options) for start in starts]
    a, b, radius = _enclosing_capsule(min(found, key=lambda result: float(result.fun)).x, scaled)
    (ax, ay, az), (bx, by, bz) = ((middle + size * end).tolist() for end in (a, b))
    # Added to each radius: more than rounding can take away of it.
    return Capsule(joint, (ax, ay, az), (bx, by, bz), size * radius + 1e-9)


def _outermost_points(points: Array) -> Array:
    """(k, 3) the points that are outermost in one of many directions, spread evenly over the sphere (Fibonacci
    lattice)."""
    if not len(points):
        return points
    n = np.arange(_DIRECTION_COUNT) + 0.5
    z, turn = 1 - 2 * n / _DIRECTION_COUNT, np.pi * (1 + 5**0.5) * n
    directions = np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    extremes: Array = points[np.unique(np.argmax(points @ directions, axis=0))]
    return extremes


def _main_axes(points: Array) -> Array:
    """(3, 3) rows: the principal axes of points (k, 3), unit vectors, the least extent first."""
    apart = points - points.mean(axis=0)
    axes: Array = np.linalg.eigh(apart.T @ apart)[1].T
    return axes


def _start_variables(points: Array) -> list[Array]:
    """(7,) variables of capsules along the main axes through the middle of the points, see `_enclosing_capsule`."""
    found = []
    for axis in _main_axes(points) if len(points) else ():
        across = points - (points @ axis)[:, None] * axis
        middle = (across.min(axis=0) + across.max(axis=0)) / 2
        found += [np.concatenate([axis, middle, [thicker]]) for thicker in _START_EXCESSES]
    return found


def _capsule_volume(x: Array, points: Array) -> float:
    """``π r² (|b − a| + 4/3 r)`` [m³] of the capsule that the variables (7,) give about points (k, 3)."""
    a, b, radius = _enclosing_capsule(x, points)
    return float(np.pi * radius**2 * (np.linalg.norm(b - a) + 4 / 3 * radius))


def _enclosing_capsule(x: Array, points: Array) -> tuple[Array, Array, float]:
    """Both ends (3,), (3,) and the radius of the shortest capsule about points (k, 3), all in the unit of the points.
    Its axis is along ``x[:3]``, of any length, through ``x[3:6]``; the radius is the least that the axis allows, times
    ``1 + x[6]²``: a thicker capsule may be shorter."""
    axis = x[:3] / np.linalg.norm(x[:3])
    apart = points - x[3:6]
    t = apart @ axis
    squared = np.maximum(np.einsum("ij,ij->i", apart, apart) - t * t, 0.0)
    widest = float(squared.max()) * (1 + x[6] ** 2) ** 2
    cap = np.sqrt(np.maximum(widest - squared, 0.0))
    low, high = float((t + cap).min()), float((t - cap).max())
    if low > high:  # one sphere is enough
        low = high = (low + high) / 2
    return x[3:6] + low * axis, x[3:6] + high * axis, float(np.sqrt(widest))
