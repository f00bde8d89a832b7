"""A true arm of the hidden simulator: measured like one, and driven to compensated commands; not a line of the package.

Its errors are those of all lengths, angles and joint zeros, an elbow that gives way under links and payload, backlash
in the first joint, and joints that come to rest a little elsewhere at every repeat.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import yaml

from tests.hidden.arms import ARMS
from tests.hidden.designs import Plan, Session, draw_postures, draw_session
from tests.hidden.draw import geometry, place
from tests.hidden.effects import FORMS, Effect, Perturbation, Site
from tests.hidden.families import Setting
from tests.hidden.files import document
from tests.hidden.mechanics import Array, walk

REPEAT = 1.5e-5  # rad: σ of every joint from repeat to repeat; some 0.02 mm at the tool
POSITION, TURN = 0.02e-3, 0.05e-3  # m and rad: σ of the instrument
PAYLOAD = 5.0  # kg, of the task
ELBOW = {"ur10": "joint3", "seven": "a4"}
WRIST = {"ur10": "joint5", "seven": "a6"}
FIRST = {"ur10": "joint1", "seven": "a1"}


@dataclass(frozen=True, eq=False)
class TrueArm:
    """An arm with its hidden errors, and the session in which it was measured."""

    site: Site
    effects: tuple[Effect, ...]
    turned: bool

    @classmethod
    def drawn(cls, kind: str, seed: int, turned: bool = True, rows: int = 110) -> TrueArm:
        """An arm with errors of 0.3 mm and 0.3 mrad; ``turned``: its orientation is measured too."""
        rng = np.random.default_rng(seed)
        arm = place(rng, ARMS[kind]())
        plan = Plan(rows=rows, repeated=15, visits=3, payloads=(0.0, 10.0), sides=False, logged=False)
        session = draw_session(rng, arm, plan)
        effects = (Effect("joint_compliance", ELBOW[kind], {"c": 8e-6}), Effect("backlash", FIRST[kind], {"b": 2e-4}))
        return cls(Site(arm, session, geometry(rng, arm, Setting(kind))), effects, turned)

    def poses(self, session: Session, rng: np.random.Generator) -> tuple[Array, Array]:
        """(N, 3) tool points [m] and (N, 3, 3) orientations where commands truly end, with fresh scatter."""
        site = Site(self.site.arm, session, self.site.deviations)
        out = Perturbation()
        for effect in self.effects:
            FORMS[effect.kind](site, effect, out)
        q = session.q.copy()
        for j, dq in out.dq.items():
            q[:, j] += dq
        q += rng.normal(0, REPEAT, q.shape)
        reached = walk(self.site.arm, q, self.site.deviations)
        return reached.p, reached.R_link[:, -1]  # the tool of these arms is not turned in the flange

    def replay(self, q: Array, seed: int = 0) -> tuple[Array, Array]:
        """The true poses at commands (N, n) that follow each other, the first reached from a joint's lower end."""
        step = np.diff(q, axis=0, prepend=q[:1] - 1.0)
        n, zeros = len(q), np.zeros(len(q))
        session = replace(
            self.site.session, q=q, pose=np.arange(n), side=np.sign(step), travel=np.abs(step),
            payload=np.full(n, PAYLOAD), temperature=zeros + 20.0, time=zeros,
        )  # fmt: skip
        return self.poses(session, np.random.default_rng(seed))

    def postures(self, count: int, seed: int) -> Array:
        """(count, n) random postures, neither stretched nor at a limit, whose nominal poses can be wanted."""
        arm = self.site.arm
        q = draw_postures(np.random.default_rng(seed), arm, 6 * count, 0.0)
        elbow, wrist = (q[:, arm.joints.index(names[arm.name])] for names in (ELBOW, WRIST))
        apart = (np.abs(q) < 0.95 * arm.upper).all(axis=1) & (np.abs(np.sin(elbow)) > 0.3)
        return q[apart & (np.abs(np.sin(wrist)) > 0.3)][:count]

    def write(self, folder: Path, seed: int) -> Path:
        """problem.yaml and data.csv as an engineer would hand them over; the problem's path."""
        rng, session, arm = np.random.default_rng(seed), self.site.session, self.site.arm
        p, R = self.poses(session, rng)
        p = p + rng.normal(0, POSITION, p.shape)
        heads = [f"{name} [deg]" for name in arm.joints] + ["x [mm]", "y [mm]", "z [mm]", "pose", "payload [kg]"]
        columns = [*np.degrees(session.q).T, *(1e3 * p).T, session.pose, session.payload]
        if self.turned:
            heads += ["qw", "qx", "qy", "qz"]
            columns += [*quaternions(R, rng.normal(0, TURN, p.shape)).T]
        with (folder / "data.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(heads)
            writer.writerows(zip(*columns, strict=True))
        (folder / "arm.urdf").write_text(arm.urdf)
        (folder / "problem.yaml").write_text(yaml.safe_dump(self._document(), sort_keys=False))
        return folder / "problem.yaml"

    def _document(self) -> dict:
        known = SimpleNamespace(nominal=self.site.arm, free=False, word=False, priors={}, truth={"sigma": POSITION})
        found = document(known)
        if self.turned:
            found["uncertainty"]["measurement"]["orientation"] = f"{TURN} rad"
        return found


def quaternions(R: Array, noise: Array) -> Array:
    """(N, 4) w, x, y, z of rotations (N, 3, 3) turned by small vectors (N, 3), world."""
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(noise) * Rotation.from_matrix(R)).as_quat(scalar_first=True)
