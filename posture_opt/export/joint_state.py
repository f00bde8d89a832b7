"""ROS messages as YAML: ``sensor_msgs/JointState`` of one posture, ``trajectory_msgs/JointTrajectory`` of several.

Source: ROS, sensor_msgs/msg/JointState and trajectory_msgs/msg/JointTrajectory; radians and metres.
"""

from __future__ import annotations

import itertools
import math
from typing import ClassVar, Literal

import numpy as np

from posture_opt.export.program_format import ProgramFormat
from posture_opt.export.robot_program import RobotProgram
from posture_opt.problem.yaml_source import dump_texts


class JointState(ProgramFormat):
    """A ROS message as YAML: of one posture a ``JointState``, of several a ``JointTrajectory``.

    Along a path, and on the lines to and from a stop, times are those of the speed of the tool point. Elsewhere they
    are those of the joint that moves most, at 1 rad/s or 1 m/s for a speed of 100 %, at least 0.1 s apart.
    """

    summary: ClassVar[str] = "ROS message as YAML: JointState, or JointTrajectory of several stops"
    most_joints: ClassVar[int] = 1000
    comment_mark: ClassVar[str] = "#"

    kind: Literal["jointstate"] = "jointstate"

    def files(self, program: RobotProgram) -> dict[str, str]:
        """``NAME.yaml``; labels of stops are comments."""
        names = dump_texts(program.robot.joint_names)
        near = f"The first stop has {_first_stop(program):g} s from wherever the arm is: see that it is near."
        lines = "Between two points the joints are interpolated: the tool is on its line at the points only."
        several = (near, lines if program.has_lines else "") if len(program) > 1 else ()
        head = self.comments(*program.head, *several)
        frame = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''"]
        if len(program) == 1:
            state = [f"name: {names}", f"position: [{', '.join(program.si[0])}]", "velocity: []", "effort: []"]
            return {f"{self.stem}.yaml": "\n".join([*head, *frame, *state, ""])}
        points = []
        for values, label, times in zip(program.si, program.labels, self._times(program), strict=True):
            for time in times:
                points += self.comments(label if time == times[0] else "")
                points += [f"- positions: [{', '.join(values)}]", f"  time_from_start: {duration(time)}"]
        return {f"{self.stem}.yaml": "\n".join([*head, *frame, f"joint_names: {names}", "points:", *points, ""])}

    @staticmethod
    def _times(program: RobotProgram) -> list[tuple[float, ...]]:
        """When the arm is to arrive at each stop and, where it waits, when it leaves it [s]."""
        found: list[tuple[float, ...]] = []
        clock = _first_stop(program)
        steps = [float(np.abs(b - a).max()) for a, b in itertools.pairwise(program.q)]
        full, before = program.speed / 100, None  # rad/s or m/s of the joint that moves most
        for step, move in zip([0.0, *steps], program.moves, strict=True):
            if move.length is not None:
                clock += move.length / program.speed_of(move)
            elif found:
                on_line = move.time is not None and before is not None and move.line
                clock += move.time - before if on_line else max(step / full, 0.1)  # type: ignore[operator]
            before = move.time
            waits = program.wait if move.waits else 0.0
            found.append((clock, clock + waits) if waits else (clock,))
            clock = found[-1][-1]
        return found


def _first_stop(program: RobotProgram) -> float:
    """Time [s] to the first stop, from wherever the arm is; longer below the usual speed of 10 percent."""
    return 5.0 * max(1.0, 10.0 / program.speed)


def duration(time: float) -> str:
    """A time [s] as the message writes it."""
    whole = math.floor(time)
    return f"{{sec: {whole}, nanosec: {min(round((time - whole) * 1e9), 999_999_999)}}}"
