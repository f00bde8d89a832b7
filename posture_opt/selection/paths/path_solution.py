"""``PathSolution``: the postures along a path, and how sure one may be of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.collision.scene import Clearance
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.improvements import Improvement, improvements
from posture_opt.selection.answer.solution import Solution, Status
from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.naive import Naive
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.multistart import Sampled
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.selection.search.search_statistics import SearchStatistics
from posture_opt.selection.stations.placement import placement_json
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.uncertainty.spread.budget import Share


@dataclass(frozen=True, eq=False, repr=False)
class PathSolution(Result):
    """The answer to a problem whose task follows a path; where it is infeasible, the motion of least largest step.

    Args:
        problem: with ``robot``, ``sources``, ``task`` and ``name``.
        path: K points, listed and added; ``targets`` those of each point.
        largest_step: allowed change of a joint between listed points [rad or m]; ``smallest_step`` the least possible.
        bound: σ_max [m] of the best posture at the point where that is largest: no motion gets below it; NaN where
            something else is minimised.
        off_line: largest distance [m] of the tool point from the straight line between points where joints move evenly.
        naive: what simpler ways give.
        placement: (4,) of the workpiece that the path stands on [m, rad]; zeros where the task names none.
        central: largest σ_max [m] along the path with the workpiece in the middle of its ranges; NaN where nothing is
            free, or nothing is feasible there.
        jumps: where no motion leads along the path, but only away from it and back: sentences.
        candidates: (K,) postures that were compared at each point.
    """

    problem: ProblemData
    optimisation_problem: OptimisationProblem
    path: TaskPath
    targets: tuple[TaskTarget, ...]
    motion: Motion
    status: Status
    largest_step: float
    smallest_step: float
    bound: float
    off_line: float
    naive: Naive
    placement: Array
    central: float
    candidates: tuple[int, ...]
    seconds: float
    jumps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()

    @cached_property
    def points(self) -> tuple[Solution, ...]:
        """All points, listed and added, in their order."""
        return tuple(self._point(k) for k in range(len(self.targets)))

    @cached_property
    def stations(self) -> tuple[Solution, ...]:
        """The listed points."""
        return tuple(point for point, listed in zip(self.points, self.path.listed, strict=True) if listed)

    def _point(self, k: int) -> Solution:
        count = self.candidates[k]
        sampled = Sampled.none(self.optimisation_problem.robot)
        statistics = SearchStatistics(count, count, 0, 0, 0, 0, sampled, None, float("nan"), 1, 0, self.seconds)
        return Solution(
            self.problem, self.optimisation_problem, self.targets[k], self.status, self.motion.Q[k], statistics,
            np.zeros((0, self.motion.Q.shape[1])), self.notes, self.reasons, self.relaxations,
        )  # fmt: skip

    @property
    def on_workpiece(self) -> bool:
        """Whether the task says where a workpiece stands, or may stand."""
        task = self.problem.task
        return task is not None and task.workpiece is not None

    @property
    def worst(self) -> Solution:
        """The point that scatters most."""
        return self.points[self.motion.worst]

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m], printed in degrees, at the first point."""
        return self.points[0].posture

    @property
    def covariance(self) -> Array:
        """(3, 3) exact covariance of the tool point at the first point, world [m²]."""
        return self.points[0].covariance

    @property
    def ellipse(self) -> Ellipsoid:
        """Ellipse of a planar arm, else ellipsoid, of the tool point at the first point."""
        return self.points[0].ellipse

    @property
    def alternatives(self) -> tuple[Solution, ...]:
        """None: other motions are not kept."""
        return ()

    @property
    def critical(self) -> Critical:
        """The spread across the path where it is largest."""
        return self.worst.critical

    @property
    def budget(self) -> tuple[Share, ...]:
        """Share of each source in the variance along the worst axis at the point that scatters most."""
        return self.worst.budget

    @property
    def largest_joint_step(self) -> float:
        """Largest change of any joint between listed points [rad, or m of a slide]."""
        Q = self.motion.Q[self.path.listed]
        moved = np.abs(np.diff(Q, axis=0))
        return float(np.max(moved))

    @cached_property
    def clearance(self) -> Clearance | None:
        """The least distance of the arm to what it is checked against, at all points; None where nothing is."""
        found: Clearance | None = self.problem.scene.clearance(self.motion.Q)
        return found

    @cached_property
    def improvements(self) -> tuple[Improvement, ...]:
        """What would lower the largest spread of this motion: smaller errors, a calibration; most gain first."""
        return () if self.status == "infeasible" else improvements(self.points, np.max)

    def gain_over(self, sigma: float) -> float:
        """Relative reduction of the largest σ_max along the path against ``sigma`` [m]."""
        return 1.0 - float(self.motion.sigma.max()) / sigma if sigma > 0 else 0.0

    def explain(self) -> str:
        """The optimisation problem of the point that scatters most, and its values there."""
        return str(self._presenter.explain())

    def to_json(self) -> dict[str, Json]:
        """The document ``solution.json``: SI units, finite numbers only; the first point at its top level."""
        onward = self.naive.onward
        return self.points[0].to_json() | {
            "clearance": None if self.clearance is None else self.clearance.to_json(),
            **({"workpiece": placement_json(self.placement)} if self.on_workpiece else {}),
            "what_would_help": [change.to_json() for change in self.improvements],
            "path": [_point_json(point) for point in self.stations],
            "largest_joint_step": self.largest_joint_step,
            "largest_step": self.largest_step,
            "smallest_step": self.smallest_step,
            "sigma_max": float(self.motion.sigma.max()),
            "sigma_max_bound": finite_or_none(self.bound),
            "off_line": self.off_line,
            "notes": [*self.jumps, *self.notes],
            "without_look_ahead": {
                "each_point_alone": self.naive.each.to_json(),
                "following_the_first": None if onward is None else onward.to_json(),
            },
            "solver": {"starts": sum(self.candidates), "converged": int(self.motion.optimal), "distinct": 1,
                       "seconds": self.seconds},
        }  # fmt: skip


def _point_json(point: Solution) -> dict[str, Json]:
    spread = point.spread
    return {
        "posture": point.posture,
        "tool": {"position": spread.position.tolist(), "quaternion_wxyz": spread.quaternion_wxyz.tolist()},
        **point.task_spread.to_json(),
    }
