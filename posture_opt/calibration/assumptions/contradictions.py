"""What the data refute of a problem file: each contradiction with its size, and all of them together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.assumptions.kinematic_coupling import fitted_ratio
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.model.effects import Cause, JointCoupling
from posture_opt.numerics import Json
from posture_opt.selection.fitted_arm import NEGLIGIBLE

FRAMES = ("base", "tool")


@dataclass(frozen=True, eq=False)
class Contradiction:
    """Something that the file states as known and the data refute; it was set aside and fitted.

    Args:
        cause: what differs from the file.
        estimate: parameter -> (deviation from the file, standard error, SI unit).
        sigma: the stated standard deviation of a parameter [SI]; 0 of a frame, which is stated as exact.
        p_value: of the likelihood ratio.
        rms_stated: RMS position error [m] of the arm calibrated as stated; ``rms`` with all contradictions set aside.
        gain: relative drop of the RMS on rows left out by setting this one aside, everything else fitted again.
    """

    cause: Cause
    estimate: Mapping[str, tuple[float, float, str]]
    sigma: float
    p_value: float
    rms_stated: float
    rms: float
    gain: float

    def to_json(self) -> dict[str, Json]:
        """The entry of ``contradictions`` in ``calibration.json``."""
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

    Args:
        sigma: parameter -> its stated σ [SI]; none of frames.
        evidence: logarithm of the likelihood ratio of all of them.
        freedom: how many parameters they hold.
        rms_stated, rms: RMS position error [m] of the arm calibrated with and without them.
        coupling: of two joints, which the file does not state and without which the data make no sense.
        gains: what each of them brings beside the others, by name; of the coupling by its kind.
    """

    names: tuple[str, ...] = ()
    sigma: Mapping[str, float] | None = None
    evidence: float = 0.0
    freedom: int = 1
    rms_stated: float = 0.0
    rms: float = 0.0
    coupling: JointCoupling | None = None
    gains: Mapping[str, float] = field(default_factory=dict)

    def contradictions(self, fit: Fit) -> tuple[Contradiction, ...]:
        """The contradictions with the sizes that the fit without them found, ``fit`` of all rows."""
        from scipy.special import gammaincc

        p = float(gammaincc(self.freedom / 2, max(self.evidence, 0.0)))
        found = []
        if self.coupling is not None:
            ratio = {"ratio": (*fitted_ratio(self.coupling, fit), "1")}
            gain = self.gains[self.coupling.kind]
            found.append(Contradiction(self.coupling, ratio, 0.0, p, self.rms_stated, self.rms, gain))
        for name in self.names:
            mine = [
                (i, q)
                for i, q in enumerate(fit.residuals.parameters)
                if (q.group == name if name in FRAMES else q.name == name)
            ]
            if not mine:
                continue
            moves = [(i, q) for i, q in mine if fit.std[i] > NEGLIGIBLE[q.unit]] or mine
            sizes = {q.name.rpartition(".")[2]: (float(fit.x[i]), float(fit.std[i]), q.unit) for i, q in moves}
            cause = GeometricDeviation.of(mine[0][1])
            sigma = 0.0 if name in FRAMES else (self.sigma or {}).get(name, 0.0)
            found.append(Contradiction(cause, sizes, sigma, p, self.rms_stated, self.rms, self.gains[name]))
        return tuple(found)
