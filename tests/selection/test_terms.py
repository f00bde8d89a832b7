"""Terms: every listed one has the slope of its differences, and manipulability is Yoshikawa's measure."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.paths.path_selector import PathSelector
from posture_opt.selection.registered_tasks import kind_of
from posture_opt.selection.tasks import TASKS
from posture_opt.selection.tasks.path_task import SeamTask
from posture_opt.selection.terms import TERMS, Term
from posture_opt.selection.terms.dexterity import Manipulability
from tests.helpers.factors import joint_jacobian
from tests.helpers.variants import conformance


def problem(robot: str = "ur10e", **task: Any) -> Any:
    given = {"robot": {"kind": "preset", "name": robot}, "uncertainty": {"repeatability": "0.05 mm"}}
    region = {"min": ["0.4 m"] * 3, "max": ["0.7 m"] * 3} if robot == "ur10e" else None
    return po.problem_from_dict({**given, "task": {"kind": "insert", "region": region, "clearance": "0.2 mm", **task}})


def evaluated(term: Term, robot: str = "ur10e") -> ca.Function:
    """``q -> (quantity and cost, their slope)``."""
    solved = po.PostureSelector(problem(robot), compiled=False)
    asked = solved.engine(solved.target).optimisation_problem
    values = ca.vertcat(ca.vec(term.quantity(asked.quantities)), term.cost(asked.quantities))
    values = ca.substitute(values, asked.nlp.p, ca.DM(solved.target.parameters))
    return ca.Function("term", [asked.q], [values, ca.jacobian(values, asked.q)])


@pytest.mark.parametrize(("robot", "rank"), [("ur10e", 3), ("iiwa14", 3), ("planar_2r", 2)])
def test_manipulability_is_the_geometric_mean_of_the_singular_values(robot: str, rank: int) -> None:
    arm = problem(robot).robot
    function = evaluated(Manipulability(kind="manipulability"), robot)
    for q in np.random.default_rng(1).uniform(-2, 2, (20, arm.n)):
        values = np.linalg.svd(joint_jacobian(arm, q)[:3], compute_uv=False)[:rank]
        expected = np.prod(values) ** (1 / rank)
        if values[-1] > 0.05 * values[0]:
            assert np.asarray(function(q)[0]).ravel() == pytest.approx([expected, (0.1 / expected) ** 2], rel=1e-4)


LOOSE: dict[str, Any] = {
    # kind -> a bound that nearly every posture keeps
    "spread": {"at_most": "1 m"}, "orientation_spread": {"at_most": "1 rad"}, "success": {"at_least": 0.01},
    "limit_margin": {"at_least": "0.1 deg"}, "link_height": {"at_least": "-9 m"},
    "singularity_margin": {"at_least": "0.1 mm"}, "manipulability": {"at_least": "0.1 mm"},
    "joint_torque": {"at_most": "900 N m"}, "near_posture": {"at_most": "9 rad"}, "fixed_joints": {},
}  # fmt: skip


ARMS = ["planar_2r", "planar_2r in space", "ur10e"]
SEAMS = [kind_of(task) for task in TASKS if issubclass(task, SeamTask)]
BUILT = [
    (kind_of(task), arm) for task in TASKS for arm in ARMS if arm == "ur10e" or getattr(task, "axis", "") != "required"
]


@pytest.mark.parametrize(
    ("task", "arm"),
    conformance(BUILT, [pair for pair in BUILT if pair[1] == "planar_2r" or pair == ("measure", "planar_2r in space")]),
)
def test_every_term_can_be_built_with_every_task(task: str, arm: str) -> None:
    """As objective and as requirement: a number, and a slope, whatever part of the spread the task counts."""
    name = arm.split()[0]
    held = {"wrist_3" if name == "ur10e" else "joint1": "30 deg"}
    own = {"near_posture": {"posture": held}, "fixed_joints": {"values": held}}
    terms = [{"kind": kind, **own.get(kind, {}), **LOOSE[kind]} for kind in map(kind_of, TERMS)]
    terms = [term for term in terms if name == "ur10e" or term["kind"] not in ("joint_torque", "link_height")]
    spread: Any = {"sigma": {"joint2.d": "1 mm", "joint1.theta": "1 mrad"}}
    place = ["0.6 m", "0.2 m", "0 m"]
    where = {"points": [place, ["0.6 m", "0.3 m", "0 m"]]} if task in SEAMS else {"position": place}
    asked = [term for term in terms if term["kind"] != "fixed_joints"]
    given = po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": name},
            "uncertainty": spread if "space" in arm else {"repeatability": "0.05 mm"},
            "task": {
                "kind": task, "direction": [0, -1, 0], "clearance": "9 mm", **where, "minimize": asked,
                "subject_to": terms,
            },
        }
    )  # fmt: skip
    motion = PathSelector.of(given) if task in SEAMS else None
    solved = motion.selector if motion else po.PostureSelector(given, compiled=False)
    targets = motion.targets if motion else [solved.target]
    nlp = solved.engine_of_all(targets).optimisation_problem.nlp
    every = ca.vertcat(nlp.objective, nlp.g)
    at = ca.Function("at", [nlp.x, nlp.p], [every, ca.jacobian(every, nlp.x)])
    for values in at(np.full(nlp.x.shape[0], 0.4), targets[0].parameters):
        assert np.isfinite(np.asarray(values)).all()


@pytest.mark.parametrize(
    ("place", "terms", "said"),
    [
        ("subject_to", [{"kind": "fixed_joints", "values": {"joint1": a}} for a in ("10 deg", "40 deg")], "joint1"),
        ("subject_to", [{"kind": "limit_margin", "at_least": a} for a in ("1 deg", "2 deg")], "limit_margin"),
        ("minimize", [{"kind": "manipulability"}, {"kind": "manipulability", "weight": 2}], "manipulability"),
    ],
)
def test_terms_that_speak_of_the_same_are_refused(place: str, terms: list[Any], said: str) -> None:
    with pytest.raises(
        po.errors.InputError, match=rf"task\.{place}\[1\]: .*{said} is stated twice, first in {place}\[0\] – keep"
    ):
        problem("planar_2r", direction=[0, -1, 0], **{place: terms})


def test_manipulability_of_an_arm_that_moves_nothing_is_refused() -> None:
    joint = {"name": "j", "type": "revolute", "a": 0, "alpha": 0, "d": 0, "theta": 0, "limits": ["-1 rad", "1 rad"]}
    task = {"kind": "insert", "position": [0, 0, 0], "minimize": [{"kind": "manipulability"}]}
    data = {"robot": {"kind": "dh", "joints": [joint]}, "uncertainty": {"sigma": {"j.theta": "1 mrad"}}, "task": task}
    with pytest.raises(po.errors.InputError, match=r"task.minimize\[0\]: manipulability bounds nothing"):
        po.select_posture(po.problem_from_dict(data))
