"""Plans for instruments that measure no position: postures at which their places can be touched, read or seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.scene import Scene
from posture_opt.collision.segment_distances import to_segment
from posture_opt.measurements.kinds import BoardPose, Kind, MarkerPixels, PairContact, Seen
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Codes, Mask, stacked_rows
from posture_opt.robot.robot import Joint, Robot


@dataclass(frozen=True, eq=False)
class KindPlaces:
    """The places of an instrument as a fit to the given rows has them, and where they can be measured from.

    A planned posture is a row of w numbers: the joints of the arm, then those of a second arm [rad or m].
    """

    data: Measurements  # the given rows of this instrument
    robot: Robot
    # parameter of the arm -> its deviation in the fit [rad or m]; ``values`` (P, u) unknowns of the places
    moved: Mapping[str, float]
    values: Array

    @classmethod
    def of(cls, residuals: Residuals, x: Array) -> KindPlaces:
        """From the given rows and the fit to them, x (k,) [rad, m]."""
        return cls(residuals.data, residuals.robot, moved_parameters(residuals, x), residuals.places(x))

    @property
    def kind(self) -> Kind:
        """What is measured."""
        return self.data.kind

    @property
    def each(self) -> int:
        """How many readings stand for one posture."""
        return 1

    @cached_property
    def further(self) -> tuple[tuple[str, Joint], ...]:
        """Names and joints of a second arm."""
        arms = self.kind.second_arms.items()
        return tuple((f"{name}.{joint.name}", joint) for name, arm in arms for joint in arm.robot.joints)

    @property
    def fixed(self) -> int:
        """How many numbers of a posture are no joints."""
        return 0

    @cached_property
    def given(self) -> Array:
        """(N, w) the postures of the given rows."""
        if not self.further:
            return self.data.q
        assert self.data.reading is not None, "the joints of a second arm were read"
        return np.column_stack([self.data.q, self.data.reading[:, : len(self.further)]])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P, m) least and largest `Kind.aspect` at each place: the stroke of a bar, the plate, how it was touched."""
        aspect, point = self._aspect_of_given(), self.data.point
        nowhere = (np.full(aspect.shape[1], np.inf), np.full(aspect.shape[1], -np.inf))
        kinds = [self.kind.bounds(k, aspect[point == k]) if np.any(point == k) else nowhere for k in range(self._count)]
        low, high = (np.array(rows) for rows in zip(*kinds, strict=True))
        return low, high

    @property
    def _count(self) -> int:
        return max(len(self.data.point_names), 1)

    def _aspect_of_given(self) -> Array:
        """(N, m) of the given rows."""
        return self.kind.aspect(self.seen(self.given, self.data.point))

    def seen(self, q: Array, place: Codes) -> Seen:
        """The fitted arm at postures (N, w) beside places (N,)."""
        n = len(q)
        columns = [np.ascontiguousarray(column) for column in q.T[: self.robot.n]]
        reached = walk(self.robot.factors, factor_values(self.robot.factors, columns, self.moved))
        position = stacked_rows(reached.position, n).T
        axes = [stacked_rows(column, n).T for column in reached.columns]
        shown = q[:, self.robot.n :] if self.further else np.zeros((n, 3))
        return Seen(position, axes, shown, place, self.values[place])

    def offered(self, q: Array) -> tuple[Codes, Mask]:
        """(N,) the place that is measured from each posture, and whether any can be."""
        n, (low, high) = len(q), self.bounds
        cost = np.full((n, self._count), np.inf)
        seen = self.seen(q, np.zeros(n, dtype=np.intp))
        for k in range(self._count):
            here = self._beside(seen, np.full(n, k, dtype=np.intp))
            aspect = self.kind.aspect(here)
            inside = np.all((aspect >= low[k]) & (aspect <= high[k]), axis=1)
            off = np.abs(aspect[:, 0] - (low[k, 0] + high[k, 0]) / 2)
            if self.kind.contact:
                off = np.linalg.norm(self._error(here), axis=1)
                # 1e-3 m: a posture that near to a place touches it: the move that touches stops there.
                inside &= off <= 1e-3
            cost[inside, k] = off[inside]
        return cost.argmin(axis=1), np.isfinite(cost.min(axis=1))

    def weights(self, q: Array) -> Array:
        """(N, each) how much each reading of a posture counts."""
        return np.ones((len(q), self.each))

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether a link is in the way."""
        return np.zeros(len(q), dtype=bool)

    def drawn(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, w) postures, before those that measure nothing are left out: half at random, half about given ones.

        lower, upper (w,) where the joints may be.
        """
        anywhere = rng.uniform(lower, upper, (count // 2, len(lower)))
        return np.concatenate([anywhere, self.about_given(rng, count - count // 2, lower, upper)])

    def about_given(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, w) postures about those of the given rows."""
        about = self.given[rng.integers(len(self.given), size=count)]
        joints = (*self.robot.joints, *(joint for _, joint in self.further))
        # 0.3 rad, or share of a slide's range: how far new postures are from those of the given rows, one σ.
        step = 0.3 * np.where([joint.type == "revolute" for joint in joints], 1.0, upper - lower)
        return np.asarray(np.clip(about + rng.normal(0.0, step, about.shape), lower, upper))

    def touching(self, q: Array) -> Array:
        """Postures (N, w) led to the nearest place by Newton steps of least length; as they are where none is touched.

        ``q − Jᵀ (J Jᵀ)⁻¹ e`` with e what is left to the place.
        """
        if not self.kind.contact:
            return q
        seen = self.seen(q, np.zeros(len(q), dtype=np.intp))
        codes = [np.full(len(q), k, dtype=np.intp) for k in range(self._count)]
        off = np.stack([np.linalg.norm(self._error(self._beside(seen, k)), axis=1) for k in codes])
        place, h = off.argmin(axis=0), 1e-6
        for _ in range(8):
            here = self._error(self.seen(q, place))
            moved = [self._error(self.seen(q + step, place)) - here for step in h * np.eye(q.shape[1])]
            # 1e-2 of the largest: directions in which a posture can hardly be led to a place are given up.
            inverse = np.linalg.pinv(np.stack(moved, axis=2) / h, rcond=1e-2)
            q = q - np.clip(np.einsum("njd,nd->nj", inverse, here), -0.3, 0.3)  # rad or m a step
        return q

    def _error(self, seen: Seen) -> Array:
        """(N, d) what is left to the places."""
        n = len(seen.place)
        return np.stack([np.broadcast_to(slot, n) for slot in self.kind.error(seen)], axis=1)

    def _beside(self, seen: Seen, place: Codes) -> Seen:
        return replace(seen, place=place, values=self.values[place])

    def rows(self, planned: Measurements, q: Array) -> Measurements:
        """Planned rows of postures (N, w) as rows of this instrument, each at its place."""
        place, _ = self.offered(q)
        return self.as_read(planned, self.seen(q, place))

    def as_read(self, planned: Measurements, seen: Seen) -> Measurements:
        """Planned rows with what would be read there."""
        data, n = self.data, len(planned)
        return replace(
            planned, position=None, measured_axes=data.measured_axes, rotation=None, reading=self.kind.expected(seen),
            point=seen.place, point_names=data.point_names, instrument=data.kind,
            second=seen.second if len(seen.second) else None, second_names=data.second_names,
            lever=None if data.lever is None else np.ones(n),
        )  # fmt: skip

    def second(self, q: Array) -> Array:
        """(N, m) the joints of a second arm at postures (N, w); NaN where another instrument is used."""
        return q[:, self.robot.n :]

    def columns(self, q: Array) -> dict[str, tuple[str, ...]]:
        """Column of the file of measurements -> its values (N, w) at each posture, the joints left out."""
        if not self.kind.label:
            return {}
        place, _ = self.offered(q)
        return {self.kind.label: tuple(self.data.point_names[k] for k in place)}

    def columns_by_row(self, q: Array) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Column -> for each posture (N, w) its cells, where several rows of the file are of one posture."""
        return {}


def moved_parameters(residuals: Residuals, x: Array) -> dict[str, float]:
    """Parameter of the arm, without those of effects -> its deviation in a fit x (k,) [rad or m]."""
    known, rows = residuals.robot.parameters, zip(residuals.parameters, x, strict=True)
    return {p.source: float(v) for p, v in rows if p.source in known and p.code <= 0}  # of several tools the first


@dataclass(frozen=True, eq=False)
class PicturePlaces(KindPlaces):
    """Cameras and boards as a fit to the given pictures has them, and from where they can be seen."""

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
    """A camera on the tool and its board as a fit to the given poses has them."""

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
    """The four corners that stand for points (n, 3), each the farthest from those before; all of a few."""
    if len(points) <= 4 or np.ptp(points, axis=0).max() == 0:
        return np.arange(len(points))
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while len(chosen) < 4:
        far = np.min(np.linalg.norm(points[:, None] - points[chosen], axis=2), axis=1)
        chosen.append(int(np.argmax(far)))
    return np.array(chosen)


@dataclass(frozen=True, eq=False)
class PairPlaces(KindPlaces):
    """Where the second arm stands by a fit to the given rows, and in which postures of both the tools touch."""

    @property
    def kind(self) -> PairContact:
        """The touches, with the second arm."""
        assert isinstance(self.data.kind, PairContact), "two arms touch"
        return self.data.kind

    @cached_property
    def scene(self) -> Scene:
        """The second arm beside itself."""
        return Scene.of(self.kind.second.robot, None, guessed=True, without_mounting=True)

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether the second arm meets itself, or more than the tools of both meet."""
        if not len(q):
            return np.zeros(0, dtype=bool)
        checked = self._apart(self.given, placed).min(axis=0) > 0
        met = np.any(self._apart(q, placed)[:, checked] < 0, axis=1)
        return np.asarray(met | (self.scene.slack(q[:, self.robot.n :]) < 0))

    def _apart(self, q: Array, placed: PlacedCapsules) -> Array:
        """(N, pairs) distances of the capsules of one arm from those of the other; of both tools, infinite [m]."""
        own, other = placed, self.scene.placed
        T = self.kind.frame.pose(self.values[0])
        starts, ends = (p @ T[:3, :3].T + T[:3, 3] for p in other.segments(q[:, self.robot.n :]))
        first, last = own.segments(q[:, : self.robot.n])
        between = to_segment(first[:, :, None], last[:, :, None], starts[:, None], ends[:, None])
        between = between - own.radii[:, None] - other.radii
        tools = (np.array(own.bodies) == own.robot.n)[:, None] & (np.array(other.bodies) == other.robot.n)
        return np.asarray(np.where(tools, np.inf, between).reshape(len(q), -1))
