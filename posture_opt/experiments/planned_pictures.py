"""Plans for cameras: postures in which a board is seen whole, large enough and from its front, and no link hides it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.segment_distances import to_segment
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.measurements.kinds import BoardPose, MarkerPixels, Seen
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask

_OUTERMOST = 4
"""Points of a board that stand for all of it: its corners."""


@dataclass(frozen=True, eq=False)
class PicturePlaces(KindPlaces):
    """Cameras and boards as a fit to the given pictures has them, and from where they can be seen.

    A camera sees from the distances and under the angles of the given pictures. The outermost points of a board count
    for all of it.
    """

    @property
    def kind(self) -> MarkerPixels:
        """Cameras and what they see."""
        assert isinstance(self.data.kind, MarkerPixels), "pictures are of markers"
        return self.data.kind

    @cached_property
    def shown(self) -> tuple[Codes, Codes, Array]:
        """Cameras, markers and weights (m,) of the points that stand for what each camera sees."""
        assert self.data.second is not None, "pictures are of markers"
        bodies, pairs = self.kind.bodies, np.unique(np.stack([self.data.point, self.data.second], axis=1), axis=0)
        cameras, markers, weights = list[int](), list[int](), list[float]()
        for camera in np.unique(pairs[:, 0]):
            seen = pairs[pairs[:, 0] == camera, 1]
            for body in np.unique(bodies.body[seen]):
                own = seen[bodies.body[seen] == body]
                chosen = own[_outermost(bodies.points[own])]
                cameras += [int(camera)] * len(chosen)
                markers += chosen.tolist()
                weights += [float(np.sqrt(len(own) / len(chosen)))] * len(chosen)
        return np.array(cameras), np.array(markers), np.array(weights)

    @property
    def each(self) -> int:
        """How many points stand for one posture."""
        return len(self.shown[0])

    @property
    def _count(self) -> int:
        """The cameras."""
        return len(self.kind.names)

    def _aspect_of_given(self) -> Array:
        """(N, 4) cosine to the board's normal, distance [m], and pixels."""
        assert self.data.second is not None, "pictures are of markers"
        return self.kind.aspect(self._of_markers(self.given, self.data.point, self.data.second))

    def _of_markers(self, q: Array, camera: Codes, marker: Codes) -> Seen:
        """Markers (N,) that cameras (N,) look at from postures (N, n)."""
        seen = self.seen(q, camera)
        return replace(seen, values=seen.values + self.values[self.kind.second_place(marker)], second=marker)

    def points_seen(self, q: Array) -> Seen:
        """All points at postures (N, n), those of one posture behind each other."""
        camera, marker, _ = self.shown
        return self._of_markers(np.repeat(q, self.each, axis=0), np.tile(camera, len(q)), np.tile(marker, len(q)))

    def offered(self, q: Array) -> tuple[Codes, Mask]:
        """(N,) a camera that sees all of its points at each posture, and whether any does."""
        whole = self._whole(q)
        return np.asarray(whole.argmax(axis=1), dtype=np.intp), np.asarray(whole.any(axis=1))

    def weights(self, q: Array) -> Array:
        """(N, m) how much each point counts: not at all where its camera does not see all."""
        camera, _, weights = self.shown
        return np.asarray(self._whole(q)[:, camera] * weights)

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether a link is between the camera and what it sees; the last one carries either of them."""
        own = self.shown[0] == self.offered(q)[0][:, None]
        return np.asarray(np.any(_interrupted(self.kind.sight(self.points_seen(q)), q, placed) & own, axis=1))

    def drawn(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, n) postures about those of the given pictures: of others, hardly one in a thousand sees a board."""
        return self.about_given(rng, count, lower, upper)

    def rows(self, planned: Measurements, q: Array) -> Measurements:
        """Planned rows as rows of pictures: one for each point of each posture."""
        whole = planned.take(np.repeat(np.arange(len(planned)), self.each))
        return replace(self.as_read(whole, self.points_seen(q)), lever=np.ones(len(whole)))

    def columns_by_row(self, q: Array) -> dict[str, tuple[tuple[str, ...], ...]]:
        """A row for each point of every camera that sees all of its points."""
        assert self.data.second is not None, "pictures are of markers"
        pairs = np.unique(np.stack([self.data.point, self.data.second], axis=1), axis=0)
        rows = [pairs[whole[pairs[:, 0]]] for whole in self._whole(q)]
        named = ((self.kind.label, self.data.point_names), (self.kind.second_label, self.data.second_names))
        return {
            label: tuple(tuple(names[k] for k in own[:, i]) for own in rows) for i, (label, names) in enumerate(named)
        }

    def _whole(self, q: Array) -> Mask:
        """(N, C) which cameras see all of their points."""
        camera, (low, high) = self.shown[0], self.bounds
        aspect = self.kind.aspect(self.points_seen(q)).reshape(len(q), self.each, 4)
        inside = np.all((aspect >= low[camera]) & (aspect <= high[camera]), axis=2)
        return np.stack([inside[:, camera == k].all(axis=1) for k in range(len(self.kind.names))], axis=1)


@dataclass(frozen=True, eq=False)
class BoardPosePlaces(KindPlaces):
    """A camera on the tool and its board as a fit to the given poses has them.

    The middle of the board stays within the directions, distances and tilts of the given poses.
    """

    @property
    def kind(self) -> BoardPose:
        """The camera and its board."""
        assert isinstance(self.data.kind, BoardPose), "poses of a board"
        return self.data.kind

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether a link is between the camera and the board."""
        seen = self.seen(q, np.zeros(len(q), dtype=np.intp))
        return np.asarray(_interrupted(self.kind.sight(seen), q, placed).any(axis=1))

    def drawn(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, n) postures about those of the given poses, as of pictures."""
        return self.about_given(rng, count, lower, upper)


def _interrupted(sight: tuple[Array, Array], q: Array, placed: PlacedCapsules) -> Mask:
    """(N, m) whether a link is in lines of sight, (N m, 3) each, of postures (N, n); the last one carries an end."""
    chosen = [k for k, frame in enumerate(placed.frames) if frame < placed.robot.n]
    if not chosen or not len(q):
        return np.zeros((len(q), 1), dtype=bool)
    start, end = (ends.reshape(len(q), -1, 1, 3) for ends in sight)
    starts, ends = (ends[:, None, chosen] for ends in placed.segments(q))
    return np.asarray(np.any(to_segment(start, end, starts, ends) < placed.radii[chosen], axis=2))


def _outermost(points: Array) -> Codes:
    """The corners of points (n, 3), each the farthest from those before; all of a few, and of one body without size."""
    if len(points) <= _OUTERMOST or np.ptp(points, axis=0).max() == 0:
        return np.arange(len(points))
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while len(chosen) < _OUTERMOST:
        far = np.min(np.linalg.norm(points[:, None] - points[chosen], axis=2), axis=1)
        chosen.append(int(np.argmax(far)))
    return np.array(chosen)
