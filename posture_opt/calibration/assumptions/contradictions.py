"""What the data refute of a problem file: each contradiction with its cause, its size and its words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.readings import coupling_readings, fitting_readings, sample_of
from posture_opt.model.arm import Arm
from posture_opt.model.effects import Cause, FittedSizes, JointCoupling, Size
from posture_opt.numerics import Json
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import NEGLIGIBLE
from posture_opt.units import ERROR_UNITS, plus_minus

_KIND_OF_PARAMETER = {
    "theta": "joint_offset",
    "yaw": "joint_offset",
    "a": "link_length",
    "x": "link_length",
    "y": "link_length",
    "d": "link_offset",
    "z": "link_offset",
    "alpha": "link_twist",
    "roll": "link_twist",
    "pitch": "link_twist",
    "beta": "axis_tilt",
}
_PHRASES = {
    "joint_offset": "{target} has a zero offset",
    "link_length": "the length of the {link} differs from the file",
    "link_offset": "the offset along the axis of {target} differs from the file",
    "link_twist": "the twist of the {link} differs from the file",
    "axis_tilt": "the axis behind {target} is tilted from what the file states",
    "base_frame": "the base frame differs from the file",
    "tool_frame": "the tool frame differs from the file",
    "geometry": "many geometric parameters differ from the file",
}
_NOUNS = {
    "joint_offset": "zero of {target}",
    "link_length": "length of the {link}",
    "link_offset": "offset along the axis of {target}",
    "link_twist": "twist of the {link}",
    "axis_tilt": "tilt of the axis behind {target}",
}
_INSPECTIONS = {
    "joint_offset": "zero mark of {target}: was it mastered again, its motor or encoder changed, or its belt moved?",
    "link_length": "type and version of the arm in the file; the {link}: exchanged, or bent",
    "link_offset": "type and version of the arm in the file; spacers and flange of {target}",
    "link_twist": "flange and seat of the {link}: a collision, dirt, or bolts tightened unevenly",
    "axis_tilt": "flange and bearing seat behind {target}: a collision, dirt, or bolts tightened unevenly",
    "base_frame": "where the base is mounted, and how its frame was measured",
    "tool_frame": "mounting of tool and reflector, and the offsets that the file has of them",
    "geometry": "type and version of the arm in the file; the maker's calibration of this arm in its controller",
}


@dataclass(frozen=True)
class GeometricDeviation(Cause):
    """A wrong geometric parameter of a joint or link, a wrong frame, or many of them together."""

    # ``joint_offset``, ``link_length``, ``link_offset``, ``link_twist``, ``axis_tilt``, ``base_frame``, ``tool_frame``
    # or ``geometry``
    kind: str
    target: str  # the joint or frame; ``all`` of ``geometry``

    @classmethod
    def of(cls, parameter: Parameter) -> GeometricDeviation:
        """The deviation of one parameter."""
        prefix, _, last = parameter.name.rpartition(".")
        if parameter.group in ("base", "tool"):
            return cls(f"{parameter.group}_frame", parameter.group)
        prismatic_value = last == "d" and parameter.unit == "rad"
        return cls("joint_offset" if prismatic_value else _KIND_OF_PARAMETER[last], prefix)

    @classmethod
    def of_all(cls) -> GeometricDeviation:
        """Many parameters together, none of which is prominent."""
        return cls("geometry", "all")

    def noun_on(self, robot: Robot) -> str:
        """The parameter in words: "twist of the link from elbow to wrist_1"."""
        return _NOUNS[self.kind].format(target=self.target, link=robot.link_words(self.target))

    @property
    def single(self) -> bool:
        """Whether it is one parameter, or one frame."""
        return self.kind != "geometry"

    @property
    def words(self) -> str:
        """The cause in a sentence of a report."""
        return _PHRASES[self.kind].format(target=self.target, link=f"link behind {self.target}")

    def inspect(self, robot: Robot) -> str:
        """What to look at on the arm."""
        return _INSPECTIONS[self.kind].format(target=self.target, link=robot.link_words(self.target))

    @property
    def moved_joint(self) -> str:
        """The joint whose zero is off; empty for all other kinds."""
        return self.target if self.kind == "joint_offset" else ""

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Estimates in mm and mrad with their standard errors, in the units of all causes."""
        one = len(estimate.values) == 1
        return tuple(
            Size("deviation" if one else name, plus_minus(v, s, *ERROR_UNITS[unit]))
            for name, (v, s, unit) in estimate.values.items()
        )


def full_coupling(arm: Arm, data: Measurements, measurement: object) -> JointCoupling | None:
    """The coupling of ratio ±1 without which no base and no tool lets the nominal arm come near the data, if any."""
    sample = sample_of(data, arm, measurement)
    if sample is None:
        return None
    _, fits = fitting_readings(sample, arm, lambda: [*coupling_readings(arm.robot)])
    found = next((reading.coupling for reading, _ in fits), None)
    if found is None:
        return None
    joint, follows, ratio = found
    coupling = JointCoupling(joint=joint, follows=follows, estimate={"ratio": ratio})
    return None if coupling.name in {effect.name for effect in arm.effects} else coupling


def fitted_ratio(coupling: JointCoupling, fit: Fit) -> tuple[float, float]:
    """The ratio of a coupling that the arm of a fit has, and its standard error, to first order about the fit.

    The step is that of linear regression, ``− zᵀr / zᵀz``, with the column z of the coupling projected off all that was
    fitted.
    """
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    r, J = used.residuals_and_jacobian(fit.x)
    A = np.linalg.qr(J @ fit.directions)[0]
    (z,) = EffectSensitivities(used, fit.x).columns(coupling).T
    z, r = (v - A @ (A.T @ v) for v in (z, r))
    length = max(float(z @ z), 1e-300)
    return float(coupling.values[0] - z @ r / length), float(np.sqrt(fit.variance / length))


FRAMES = ("base", "tool")


@dataclass(frozen=True, eq=False)
class Contradiction:
    """Something that the file states as known and the data refute; it was set aside and fitted."""

    cause: Cause  # what differs from the file
    estimate: Mapping[str, tuple[float, float, str]]  # parameter -> (deviation from the file, standard error, SI unit)
    sigma: float  # the stated standard deviation of a parameter [SI]; 0 of a frame, which is stated as exact
    p_value: float  # of the likelihood ratio
    # RMS position error [m] of the arm calibrated as stated; ``rms`` with all contradictions set aside
    rms_stated: float
    rms: float
    gain: float  # relative drop of the RMS on rows left out by setting this one aside, everything else fitted again

    def to_json(self) -> dict[str, Json]:
        return {
            "kind": self.cause.kind,
            "target": self.cause.target,
            "estimate": {name: {"value": v, "std": s, "unit": u} for name, (v, s, u) in self.estimate.items()},
            "sigma": self.sigma,
            "p_value": self.p_value,
            "rms": {"as_stated": self.rms_stated, "set_aside": self.rms},
        }


@dataclass(frozen=True, eq=False)
class Refuted:
    """Statements that the data refute: frames, and names of parameters whose σ is wrong.

    The p-value of all of them together is that of Wilks (1938): ``P(χ²_f > 2 · evidence)`` with f = ``freedom``.
    """

    names: tuple[str, ...] = ()
    sigma: Mapping[str, float] | None = None  # parameter -> its stated σ [SI]; none of frames
    evidence: float = 0.0  # logarithm of the likelihood ratio of all of them
    freedom: int = 1  # how many parameters they hold
    rms_stated: float = 0.0  # rms_stated, rms: RMS position error [m] of the arm calibrated with and without them
    rms: float = 0.0
    # of two joints, which the file does not state and without which the data make no sense
    coupling: JointCoupling | None = None
    # what each of them brings beside the others, by name; of the coupling by its kind
    gains: Mapping[str, float] = field(default_factory=dict)

    def contradictions(self, fit: Fit) -> tuple[Contradiction, ...]:
        """The contradictions with the sizes that the fit without them found, ``fit`` of all rows."""
        from scipy.special import gammaincc

        p = float(gammaincc(self.freedom / 2, max(self.evidence, 0.0)))  # P(χ²_f > 2 · evidence), Wilks (1938)
        found = []
        if self.coupling is not None:
            ratio = {"ratio": (*fitted_ratio(self.coupling, fit), "1")}
            gain = self.gains[self.coupling.kind]
            found.append(Contradiction(self.coupling, ratio, 0.0, p, self.rms_stated, self.rms, gain))
        for name in self.names:
            every = enumerate(fit.residuals.parameters)
            mine = [(i, q) for i, q in every if (q.group if name in FRAMES else q.name) == name]
            if not mine:
                continue
            moves = [(i, q) for i, q in mine if fit.std[i] > NEGLIGIBLE[q.unit]] or mine
            sizes = {q.name.rpartition(".")[2]: (float(fit.x[i]), float(fit.std[i]), q.unit) for i, q in moves}
            cause, sigma = GeometricDeviation.of(mine[0][1]), (self.sigma or {}).get(name, 0.0)
            found.append(Contradiction(cause, sizes, sigma, p, self.rms_stated, self.rms, self.gains[name]))
        return tuple(found)
