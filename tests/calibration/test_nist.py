"""The fitter against certified results: NIST Statistical Reference Datasets, nonlinear regression, all 27 of them.

Data and certified values: National Institute of Standards and Technology, public domain; one file a problem in
``nist/``: both starting points, estimates and their standard deviations; residual sum of squares; the data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.optimize

from posture_opt.calibration.estimation.least_squares import Minimum, least_squares

Values = Any  # np.ndarray of the precision asked for
Model = Callable[[Values, Values], Values]
FOLDER = Path(__file__).parent / "nist"


def gauss(b: Values, x: Values) -> Values:
    return (
        b[0] * np.exp(-b[1] * x)
        + b[2] * np.exp(-(((x - b[3]) / b[4]) ** 2))
        + b[5] * np.exp(-(((x - b[6]) / b[7]) ** 2))
    )


def three_decays(b: Values, x: Values) -> Values:
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def cubic_ratio(b: Values, x: Values) -> Values:
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1 + x * (b[4] + x * (b[5] + x * b[6])))


def quadratic_ratio(b: Values, x: Values) -> Values:
    return (b[0] + x * (b[1] + x * b[2])) / (1 + x * (b[3] + x * b[4]))


def decay_ratio(b: Values, x: Values) -> Values:
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


def saturation(b: Values, x: Values) -> Values:
    return b[0] * (1 - np.exp(-b[1] * x))


def wave(cosine: Values, sine: Values, period: Values, x: Values) -> Values:
    return cosine * np.cos(2 * np.pi * x / period) + sine * np.sin(2 * np.pi * x / period)


MODELS: dict[str, Model] = {
    "bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "boxbod": saturation,
    "chwirut1": decay_ratio,
    "chwirut2": decay_ratio,
    "danwood": lambda b, x: b[0] * x ** b[1],
    "eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "enso": lambda b, x: b[0] + wave(b[1], b[2], 12, x) + wave(b[4], b[5], b[3], x) + wave(b[7], b[8], b[6], x),
    "gauss1": gauss,
    "gauss2": gauss,
    "gauss3": gauss,
    "hahn1": cubic_ratio,
    "kirby2": quadratic_ratio,
    "lanczos1": three_decays,
    "lanczos2": three_decays,
    "lanczos3": three_decays,
    "mgh09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "mgh10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "mgh17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "misra1a": saturation,
    "misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),  # of the logarithm of y
    "rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "thurber": cubic_ratio,
}
# The scaled first step of MGH10 from NIST's first start, (2, 400000, 25000), takes b1 towards 0, into the valley where
# b1 = exp(-b2 / (x + b3)) falls to 1e-48 and a step can change it by no more than a small share: see its own test.
# Lanczos1 was generated with 13 decimals: its residuals, 9e-14, are some 200 roundings of its y, up to 2.5.
CASES = [(name, start) for name in MODELS for start in (1, 2) if (name, start) != ("mgh10", 1) and name != "lanczos1"]


@dataclass(frozen=True)
class Certified:
    x: Values
    y: Values
    starts: Values
    estimates: Values
    deviations: Values
    rss: float


def read(name: str, precision: type = np.float64) -> Certified:
    blocks = (FOLDER / f"{name}.csv").read_text().strip().split("\n\n")
    parameters, rss, data = (
        np.array([[precision(value) for value in row.split(",")] for row in block.splitlines()[1:]]) for block in blocks
    )
    x = data[:, 1:].T if data.shape[1] > 2 else data[:, 1]
    y = np.log(data[:, 0]) if name == "nelson" else data[:, 0]
    estimates, deviations = parameters[:, 2:].T
    return Certified(x, y, parameters[:, :2].T, estimates, deviations, float(rss[0, 0]))


def fitted(name: str, start: Values, precision: type = np.float64, units: Values = 1.0) -> Minimum:
    """The fit, of residuals whose derivatives are by complex steps, exact to rounding (Squire, Trapp 1998)."""
    problem = read(name, precision)

    def model(b: Values, x: Values) -> Values:
        return MODELS[name](b * units, x)

    def function(b: Values) -> tuple[Values, Values]:
        step = precision(1e-30)
        b = b.astype(precision)
        columns = [np.imag(model(b + 1j * step * unit, problem.x)) / step for unit in np.eye(len(b))]
        residuals = model(b, problem.x) - problem.y
        return residuals.astype(float), np.stack(columns, axis=1).astype(float)

    return least_squares(function, np.array(start, dtype=float) / units, max_steps=1000)


def digits(value: Values, certified: Values) -> float:
    """The number of matching digits of the worst entry, NIST's log relative error."""
    relative = np.abs(value - certified) / np.abs(certified)
    return float(-np.log10(np.maximum(relative, 1e-15)).min())


def test_all_problems_are_there() -> None:
    assert {path.stem for path in FOLDER.glob("*.csv")} == set(MODELS)
    assert len(MODELS) == 27


@pytest.mark.parametrize(("name", "start"), CASES, ids=lambda value: str(value))
def test_estimates_and_standard_errors_match_the_certified_digits(name: str, start: int) -> None:
    problem = read(name)
    fit = fitted(name, problem.starts[start - 1])
    assert fit.converged
    # Certified to 11 digits. The fitter stops within about 1e-10 of a standard error, which leaves MGH09 and Misra1c,
    # the least, 8 digits; one is kept for other processors' rounding.
    assert digits(fit.x, problem.estimates) > 7
    assert digits(fit.std, problem.deviations) > 7
    assert digits(fit.residuals @ fit.residuals, problem.rss) > 9


@pytest.mark.parametrize("start", [1, 2])
def test_residuals_of_a_few_roundings_leave_few_digits_of_the_errors(start: int) -> None:
    problem = read("lanczos1")
    fit = fitted("lanczos1", problem.starts[start - 1])
    assert digits(fit.x, problem.estimates) > 10
    # 200 roundings: two digits, and the fit has not more than the residuals have.
    assert digits(fit.std, problem.deviations) > 2
    assert digits(fit.residuals @ fit.residuals, problem.rss) > 2


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="this machine has no floating point beyond 64 bits")
@pytest.mark.parametrize("start", [1, 2])
def test_exact_residuals_give_back_the_digits(start: int) -> None:
    problem = read("lanczos1", np.longdouble)
    fit = fitted("lanczos1", problem.starts[start - 1], np.longdouble)
    # Residuals exact for the estimate at hand, which is itself rounded to 64 bits.
    assert digits(fit.x, problem.estimates) > 10
    assert digits(fit.std, problem.deviations) > 6
    assert digits(fit.residuals @ fit.residuals, problem.rss) > 6


def test_a_fit_that_does_not_arrive_says_so() -> None:
    fit = fitted("mgh10", read("mgh10").starts[0])
    assert not fit.converged
    assert abs(fit.x[0]) < 1e-30  # b1, in the valley


@pytest.mark.parametrize("rate", [100.0, 2000.0])
def test_a_plateau_has_no_standard_error(rate: float) -> None:
    # With this rate all of BoxBOD's growth lies before its first day: any rate from here on fits equally well.
    fit = fitted("boxbod", [100.0, rate])
    assert fit.x[0] == pytest.approx(read("boxbod").y.mean(), rel=1e-6)
    assert fit.std[0] == pytest.approx(read("boxbod").y.std(ddof=2) / np.sqrt(6), rel=1e-6)
    assert fit.std[1] > 1e30


def test_standard_errors_do_not_hang_on_the_units_of_the_parameters() -> None:
    problem, units = read("misra1a"), np.array([1e10, 1e-10])
    fit = fitted("misra1a", problem.starts[1], units=units)
    assert digits(fit.x * units, problem.estimates) > 7
    assert digits(fit.std * units, problem.deviations) > 7


def test_a_fit_to_rounded_values_ends_where_their_rounding_begins() -> None:
    """Residuals of 1 m in units of 10 µm, rounded as if of few digits: no step is tried over and over."""
    rng, t = np.random.default_rng(4), np.linspace(0.0, 3.0, 400)
    measured, evaluations = np.sin(1.3 * t) + rng.normal(0, 1e-5, t.size), []

    def function(x: Values) -> tuple[Values, Values]:
        evaluations.append(x)
        reached = np.round(x[0] * np.sin(x[1] * t), 13)
        return (reached - measured) / 1e-5, np.stack([np.sin(x[1] * t), x[0] * t * np.cos(x[1] * t)], axis=1) / 1e-5

    found = least_squares(function, np.array([0.9, 1.2]), tolerance=1e-9)
    exact = scipy.optimize.least_squares(
        lambda x: (x[0] * np.sin(x[1] * t) - measured) / 1e-5, [0.9, 1.2], xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    assert found.converged
    assert np.all(np.abs(found.x - exact.x) < 1e-4 * found.std)
    assert len(evaluations) < 8
