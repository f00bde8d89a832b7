"""robotkinecal as its README has it: screw axes of the nominal arm, points as observations, `solve`.

It has no unknown base frame: the axes start where the points are. It states a mean error of its last iteration and a
norm of variances a joint, from which no standard error of a parameter follows.
"""

from __future__ import annotations

import contextlib
import io

import numpy as np
import roboticstoolbox as rtb
from robotkinecal import SerialRobotKineCal

from benchmarks.calibrators import Answer, Array, Task, shift, turn

TITLE = "robotkinecal"
PACKAGES = ("robotkinecal", "roboticstoolbox-python")


def robot(task: Task, learned: Array) -> rtb.ERobot:
    """The arm with its base in the frame of the instrument; link ``tool`` has the point."""
    base, point = task.frames(learned)
    placement, links = base, []
    for i, (a, alpha, d, theta) in enumerate(task.table):
        parent = links[-1] if links else None
        links.append(rtb.Link(rtb.ETS([rtb.ET.SE3(placement), rtb.ET.Rz()]), name=f"link{i + 1}", parent=parent))
        placement = turn(2, np.array([theta]))[0] @ shift(a, 0.0, d) @ turn(0, np.array([alpha]))[0]
    tool = rtb.Link(rtb.ETS([rtb.ET.SE3(placement @ shift(*point))]), name="tool", parent=links[-1])
    return rtb.ERobot([*links, tool])


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    np.random.seed(0)  # its bases are random
    calibration = SerialRobotKineCal(robot(task, learned), "tool")
    calibration.set_observations(list(task.q[learned]), list(task.points[learned]))
    with contextlib.redirect_stdout(io.StringIO()):
        result = calibration.solve()
    n = len(task.table)
    points = np.array([calibration.forward_kinematics(n + 1, q).t for q in task.q[asked]])
    stated = float(np.sqrt(np.mean(np.square(result.iteration_results[-1].position_errors))))
    return Answer(points - task.points[asked], stated, parameters=4 * n + 3)
