"""A session of the hidden simulator as a problem and a table in memory, for errors that its families do not draw."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

import posture_opt as po
from tests.hidden.arms import ARMS
from tests.hidden.designs import Plan, Session, draw_session
from tests.hidden.draw import geometry, place
from tests.hidden.effects import Effect, Site, measured
from tests.hidden.families import Setting
from tests.hidden.files import document
from tests.hidden.mechanics import Array
from tests.hidden.noise import SIGMA


class SimulatedSession:
    """An arm with small errors of all lengths and angles, and the session in which it is measured."""

    def __init__(self, seed: int, kind: str = "ur10", plan: Plan | None = None) -> None:
        self.rng = np.random.default_rng([seed, 90])
        self.arm = place(self.rng, ARMS[kind]())
        self.session: Session = draw_session(self.rng, self.arm, plan or Plan(logged=True))
        self.deviations = geometry(self.rng, self.arm, Setting(kind))
        self.site = Site(self.arm, self.session, self.deviations)

    def points(self, *effects: Effect, sigma: float = SIGMA) -> Array:
        """(N, 3) measured points."""
        clean = measured(self.site, effects)
        return clean + self.rng.normal(0, sigma, clean.shape)

    def table(self, points: Array) -> dict[str, Any]:
        """The columns that an engineer would hand over, SI units."""
        session, arm = self.session, self.arm
        table: dict[str, Any] = {f"{name} [rad]": session.q[:, j] for j, name in enumerate(arm.joints)}
        table |= {f"{'xyz'[axis]} [m]": points[:, axis] for axis in arm.measured}
        table["pose"] = session.pose
        if session.sides_stated:
            table |= {f"{name}.approach": session.side[:, j] for j, name in enumerate(arm.joints)}
        table |= {"payload [kg]": session.payload} if session.payload_logged else {}
        return table | ({"time [s]": session.time} if session.logged else {})

    def document(self, free: bool = True) -> dict[str, Any]:
        """The problem file; ``free``: base and tool are to be found."""
        known = SimpleNamespace(nominal=self.arm, free=free, word=False, priors={}, truth={"sigma": SIGMA})
        return document(known)  # type: ignore[arg-type]

    def diagnosis(
        self, table: dict[str, Any], document: dict[str, Any] | None = None, free: bool = True
    ) -> po.Diagnosis:
        """What is found in a table; ``document`` is the usual problem file where there is none."""
        problem = po.problem_from_dict(document or self.document(free))
        return po.diagnose(problem, po.read_measurements(table, problem), plan=False)


def beyond_geometry(found: po.Diagnosis) -> list[tuple[str, str]]:
    """Kind and target of the causes that are no errors of lengths, angles and zeros."""
    geometric = ("geometry", "joint_offset", "link_length", "link_offset", "link_twist", "axis_tilt")
    return [(f.kind, f.target) for f in found.effects if f.kind not in geometric]
