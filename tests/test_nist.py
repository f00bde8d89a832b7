"""The fitter against certified results: NIST Statistical Reference Datasets, nonlinear regression.

Data and certified values: National Institute of Standards and Technology, itl.nist.gov/div898/strd, public domain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from posture_opt.diagnosis.fit import least_squares

Model = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Certified:
    model: Model
    x: list[float]
    y: list[float]
    starts: tuple[list[float], ...]
    estimates: list[float]
    deviations: list[float]
    rss: float


MISRA1A = Certified(
    model=lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    x=[77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0],
    y=[10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78],
    starts=([500, 1e-4], [250, 5e-4]),
    estimates=[2.3894212918e02, 5.5015643181e-04],
    deviations=[2.7070075241e00, 7.2668688436e-06],
    rss=1.2455138894e-01,
)
THURBER = Certified(
    model=lambda b, x: (
        (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)
    ),
    x=[
        -3.067, -2.981, -2.921, -2.912, -2.840, -2.797, -2.702, -2.699, -2.633, -2.481, -2.363, -2.322, -1.501,
        -1.460, -1.274, -1.212, -1.100, -1.046, -0.915, -0.714, -0.566, -0.545, -0.400, -0.309, -0.109, -0.103,
        0.010, 0.119, 0.377, 0.790, 0.963, 1.006, 1.115, 1.572, 1.841, 2.047, 2.200,
    ],
    y=[
        80.574, 84.248, 87.264, 87.195, 89.076, 89.608, 89.868, 90.101, 92.405, 95.854, 100.696, 101.060, 401.672,
        390.724, 567.534, 635.316, 733.054, 759.087, 894.206, 990.785, 1090.109, 1080.914, 1122.643, 1178.351,
        1260.531, 1273.514, 1288.339, 1327.543, 1353.863, 1414.509, 1425.208, 1421.384, 1442.962, 1464.350, 1468.705,
        1447.894, 1457.628,
    ],
    starts=([1000, 1000, 400, 40, 0.7, 0.3, 0.03], [1300, 1500, 500, 75, 1, 0.4, 0.05]),
    estimates=[
        1.2881396800e03, 1.4910792535e03, 5.8323836877e02, 7.5416644291e01, 9.6629502864e-01, 3.9797285797e-01,
        4.9727297349e-02,
    ],
    deviations=[
        4.6647963344e00, 3.9571156086e01, 2.8698696102e01, 5.5675370270e00, 3.1333340687e-02, 1.4984928198e-02,
        6.5842344623e-03,
    ],
    rss=5.6427082397e03,
)  # fmt: skip
MGH09 = Certified(
    model=lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    x=[4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
    y=[0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246],
    starts=([25, 39, 41.5, 39], [0.25, 0.39, 0.415, 0.39]),
    estimates=[1.9280693458e-01, 1.9128232873e-01, 1.2305650693e-01, 1.3606233068e-01],
    deviations=[1.1435312227e-02, 1.9633220911e-01, 8.0842031232e-02, 9.0025542308e-02],
    rss=3.0750560385e-04,
)
ECKERLE4 = Certified(
    model=lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    x=[
        *np.arange(400.0, 436.0, 5.0), *np.arange(436.5, 466.0, 1.5), *np.arange(470.0, 501.0, 5.0),
    ],
    y=[
        0.0001575, 0.0001699, 0.0002350, 0.0003102, 0.0004917, 0.0008710, 0.0017418, 0.0046400, 0.0065895, 0.0097302,
        0.0149002, 0.0237310, 0.0401683, 0.0712559, 0.1264458, 0.2073413, 0.2902366, 0.3445623, 0.3698049, 0.3668534,
        0.3106727, 0.2078154, 0.1164354, 0.0616764, 0.0337200, 0.0194023, 0.0117831, 0.0074357, 0.0022732, 0.0008800,
        0.0004579, 0.0002345, 0.0001586, 0.0001143, 0.0000710,
    ],
    # NIST's first start, (1, 10, 500), lies so far off that the peak is flat there.
    starts=([1.5, 5, 450],),
    estimates=[1.5543827178e00, 4.0888321754e00, 4.5154121844e02],
    deviations=[1.5408051163e-02, 4.6803020753e-02, 4.6800518816e-02],
    rss=1.4635887487e-03,
)  # fmt: skip
MGH17 = Certified(
    model=lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    x=[10.0 * i for i in range(33)],
    y=[
        0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603,
        0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411,
        0.406,
    ],
    starts=([0.5, 1.5, -1, 0.01, 0.02],),
    estimates=[3.7541005211e-01, 1.9358469127e00, -1.4646871366e00, 1.2867534640e-02, 2.2122699662e-02],
    deviations=[2.0723153551e-03, 2.2031669222e-01, 2.2175707739e-01, 4.4861358114e-04, 8.9471996575e-04],
    rss=5.4648946975e-05,
)  # fmt: skip
DANWOOD = Certified(
    model=lambda b, x: b[0] * x ** b[1],
    x=[1.309, 1.471, 1.490, 1.565, 1.611, 1.680],
    y=[2.138, 3.421, 3.597, 4.340, 4.882, 5.660],
    starts=([1, 5], [0.7, 4]),
    estimates=[7.6886226176e-01, 3.8604055871e00],
    deviations=[1.8281973860e-02, 5.1726610913e-02],
    rss=4.3173084083e-03,
)
PROBLEMS = {
    "Misra1a": MISRA1A,
    "Thurber": THURBER,
    "MGH09": MGH09,
    "Eckerle4": ECKERLE4,
    "MGH17": MGH17,
    "DanWood": DANWOOD,
}
CASES = [pytest.param(p, s, id=f"{name}-{k}") for name, p in PROBLEMS.items() for k, s in enumerate(p.starts, 1)]


def with_jacobian(problem: Certified) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Residuals and their derivatives by complex steps, exact to rounding (Squire, Trapp 1998)."""
    x, y = np.array(problem.x), np.array(problem.y)

    def function(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step = 1e-30
        columns = [np.imag(problem.model(b + 1j * step * unit, x)) / step for unit in np.eye(len(b))]
        return np.real(problem.model(b + 0j, x)) - y, np.stack(columns, axis=1)

    return function


def digits(value: np.ndarray, certified: list[float]) -> float:
    """The number of matching digits of the worst entry, NIST's log relative error."""
    relative = np.abs(value - np.array(certified)) / np.abs(certified)
    return float(-np.log10(np.maximum(relative, 1e-15)).min())


@pytest.mark.parametrize(("problem", "start"), CASES)
def test_estimates_and_standard_errors_match_the_certified_digits(problem: Certified, start: list[float]) -> None:
    fit = least_squares(with_jacobian(problem), np.array(start, dtype=float), max_steps=2000)
    assert fit.converged
    # Certified to 11 digits; the fitter has to find 6 of the estimates and of their errors.
    assert digits(fit.x, problem.estimates) > 6
    assert digits(fit.std, problem.deviations) > 6
    assert float(fit.residuals @ fit.residuals) == pytest.approx(problem.rss, rel=1e-6)
