"""A plain least squares fit on Pinocchio: all six deviations of every joint's placement, base and tool point.

What anyone would write: Gauss-Newton with Pinocchio's kinematic regressor, shortest steps where parameters cannot be
told apart, standard errors from ``s² (JᵀJ)⁺``. It states the error of its residuals, per degree of freedom.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from benchmarks.calibrators import Answer, Array, Task, shift, turn

TITLE = "Pinocchio, plain least squares"
PACKAGES = ("pin",)
ROUNDS = 20
RANK = 1e-6  # of the largest singular value, columns of length one: what is below is not told apart


def arm(table: Array) -> pin.Model:
    """The arm of the data sheet; frame ``tool`` behind its last link."""
    model, parent, placement = pin.Model(), 0, pin.SE3.Identity()
    for i, (a, alpha, d, theta) in enumerate(table):
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint{i + 1}")
        model.addJointFrame(parent)
        link = turn(2, np.array([theta]))[0] @ shift(a, 0.0, d) @ turn(0, np.array([alpha]))[0]
        placement = pin.SE3(link)
    model.addFrame(pin.Frame("tool", parent, 0, placement, pin.FrameType.OP_FRAME))
    return model


class Fit:
    """The arm with its deviations, which every step composes."""

    def __init__(self, task: Task, learned: Array) -> None:
        self.model = arm(task.table)
        self.data, self.tool = self.model.createData(), self.model.getFrameId("tool")
        base, point = task.frames(learned)
        self.model.jointPlacements[1] = pin.SE3(base) * self.model.jointPlacements[1]
        self.point = point

    def points_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """(m, 3) [m], and (m, 3, 6 n + 3) with respect to placements and tool point."""
        points, jacobian = np.zeros((len(q), 3)), np.zeros((len(q), 3, 6 * (self.model.njoints - 1) + 3))
        for i, angles in enumerate(q):
            pin.framesForwardKinematics(self.model, self.data, angles)
            flange = self.data.oMf[self.tool]
            points[i] = flange.act(self.point)
            regressor = pin.computeFrameKinematicRegressor(self.model, self.data, self.tool, pin.LOCAL)
            jacobian[i, :, :-3] = flange.rotation @ (regressor[:3] - pin.skew(self.point) @ regressor[3:])
            jacobian[i, :, -3:] = flange.rotation
        return points, jacobian

    def step(self, x: Array) -> None:
        for joint, deviation in enumerate(x[:-3].reshape(-1, 6), 1):
            self.model.jointPlacements[joint] = self.model.jointPlacements[joint] * pin.exp6(deviation)
        self.point = self.point + x[-3:]


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    found, total = Fit(task, learned), 0.0
    for _ in range(ROUNDS):
        points, jacobian = found.points_and_jacobian(task.q[learned])
        J, r = jacobian.reshape(points.size, -1), (points - task.points[learned]).ravel()
        length = np.maximum(np.linalg.norm(J, axis=0), 1e-12)
        inverse = np.linalg.pinv(J / length, rcond=RANK) / length[:, None]
        x = -inverse @ r
        found.step(x)
        total = total + x
        if np.linalg.norm(J @ x) < 1e-9 * np.sqrt(len(r)):
            break
    rank = int(np.linalg.matrix_rank(J / length, tol=RANK * np.linalg.norm(J / length, 2)))
    residuals = found.points_and_jacobian(task.q[learned])[0] - task.points[learned]
    variance = float(np.sum(residuals**2)) / (len(r) - rank)
    std = np.sqrt(variance * np.sum(inverse**2, axis=1))
    sizes = {str(i): (float(v), float(s)) for i, (v, s) in enumerate(zip(total, std, strict=True)) if s > 1e-12}
    errors = found.points_and_jacobian(task.q[asked])[0] - task.points[asked]
    return Answer(errors, float(np.sqrt(3 * variance)), sizes, rank)
