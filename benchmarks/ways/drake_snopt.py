"""Drake: `InverseKinematics` with its C++ constraints, an objective with analytic gradient, SNOPT from 16 starts."""

from __future__ import annotations

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.solvers import SnoptSolver, SolverOptions

from benchmarks.arms import Arm, Array
from benchmarks.objective import SCALE, worst_axis_gradient
from benchmarks.ways import Solve, random_starts

TITLE = "Drake SNOPT, 16 starts"

# The best of the settings tried. With SNOPT's own the Panda takes 3 to 8 times as long (1000 major iterations) and
# ends in worse optima (elastic weight 10 000).
OPTIONS = {
    "Major iterations limit": 30,
    "Major feasibility tolerance": 1e-7,
    "Major optimality tolerance": 1e-5,
    "Elastic weight": 10.0,
}
VIOLATION = 1e-7


def _plant(arm: Arm) -> MultibodyPlant:
    plant = MultibodyPlant(time_step=0.0)
    Parser(plant).AddModelsFromString(arm.chain, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(arm.base))
    plant.Finalize()
    return plant


class _Objective:
    """The worst axis for Drake's solvers: value and gradient in numbers, handed back as one AutoDiffXd.

    Letting Drake differentiate the Jacobian through an AutoDiffXd plant gives the same at ten times the cost.
    """

    def __init__(self, arm: Arm, plant: MultibodyPlant) -> None:
        self.plant, self.context = plant, plant.CreateDefaultContext()
        self.tip, self.world = plant.GetFrameByName(arm.tip), plant.world_frame()
        self.variances = np.square(arm.sigma) * SCALE

    def __call__(self, q: Array) -> float | AutoDiffXd:
        differentiated = q.dtype == object
        self.plant.SetPositions(self.context, ExtractValue(q).ravel() if differentiated else q)
        J = self.plant.CalcJacobianSpatialVelocity(
            self.context, JacobianWrtVariable.kQDot, self.tip, np.zeros(3), self.world, self.world
        )
        value, gradient = worst_axis_gradient(J[3:], J[:3], self.variances)
        return AutoDiffXd(value, gradient @ ExtractGradient(q)) if differentiated else value


def _programme(plant: MultibodyPlant, tip: str, position: Array) -> InverseKinematics:
    """Tool point at the target, tool axis at right angles to x and y, and downwards; joint limits come with it."""
    ik = InverseKinematics(plant, with_joint_limits=True)
    world, tool = plant.world_frame(), plant.GetFrameByName(tip)
    ik.AddPositionConstraint(tool, np.zeros(3), world, position, position)
    right, down = np.pi / 2, np.array([0.0, 0.0, -1.0])
    for axis in np.eye(3)[:2]:
        ik.AddAngleBetweenVectorsConstraint(world, axis, tool, np.array([0.0, 0.0, 1.0]), right, right)
    ik.AddAngleBetweenVectorsConstraint(world, down, tool, np.array([0.0, 0.0, 1.0]), 0.0, right)
    return ik


def build(arm: Arm, starts: int = 16, seed: int = 0) -> Solve:
    plant = _plant(arm)
    assert np.array_equal(plant.GetPositionLowerLimits(), arm.limits[0]), "Drake orders the joints differently"
    objective, solver, options = _Objective(arm, plant), SnoptSolver(), SolverOptions()
    for name, value in OPTIONS.items():
        options.SetOption(solver.solver_id(), name, value)

    def solve(position: Array) -> Array | None:
        ik = _programme(plant, arm.tip, position)
        ik.get_mutable_prog().AddCost(objective, vars=ik.q())
        results = [solver.Solve(ik.prog(), start, options) for start in random_starts(arm, starts, seed)]
        rows = ik.prog().GetAllConstraints()
        solved = [result for result in results if ik.prog().CheckSatisfied(rows, result.get_x_val(), VIOLATION)]
        best = min(solved, key=lambda result: result.get_optimal_cost(), default=None)
        return None if best is None else best.GetSolution(ik.q())

    return solve
