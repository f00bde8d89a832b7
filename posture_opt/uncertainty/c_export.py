"""The covariance of the tool point as C code, for controllers and other programs."""

from __future__ import annotations

import casadi as ca

from posture_opt.model.c_source import c_source
from posture_opt.uncertainty.spread import HasSources, require_sources
from posture_opt.uncertainty.tool_point import ToolPoint


def covariance_c(problem: HasSources, name: str = "tool_covariance") -> tuple[str, str]:
    """C99 text and header of ``int name(q, position, covariance, first_order)`` for the robot of a problem.

    ``q`` (n) [rad or m]; ``position`` (3) [m], world; ``covariance`` (3 x 3) and ``first_order`` (3 x 3) [m²], world.

    Raises:
        InputError: ``name`` is no free C identifier, or nothing is uncertain.
    """
    require_sources(problem.sources)
    tool_point = ToolPoint.of(problem.arm, problem.sources)
    q = ca.SX.sym("q", problem.arm.robot.n)
    moments = tool_point.moments(ca.vertsplit(q))
    results = [moments.position, moments.covariance, moments.first_order]
    function = ca.Function("spread", [q], results, ["q"], ["position", "covariance", "first_order"])
    joints = ", ".join(f"{j.name} [{j.unit}]" for j in problem.arm.robot.joints)
    described = {
        "q": f"joint values: {joints}",
        "position": "nominal tool point in the world [m]",
        "covariance": f"of the tool point in the world [m^2], {tool_point.method}",
        "first_order": "the same to first order, J Sigma J' [m^2]",
    }
    return c_source(function, name, described)
