"""``plan_discrimination``: measurements that would discriminate named effects from their rivals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.discrimination.discrimination_design import DiscriminationDesign, detection_probability
from posture_opt.diagnosis.discrimination.model_discrimination import ModelDiscrimination, Rivals
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.errors import InputError
from posture_opt.experiments.candidate_postures import candidate_rows
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Cause
from posture_opt.numerics import Array, Json, Mask
from posture_opt.selection.problem_data import ProblemData

Steps = Sequence[tuple[int, Array]]


@dataclass(frozen=True, eq=False)
class DiscriminatedPair:
    """How well an effect is discriminated from one of its rivals.

    Args:
        rival: what could replace it.
        angle: least principal angle between their columns, given the geometry and the other effects [rad].
        now: noncentrality λ of the data, the lesser of the two directions of taking one for true.
        then: λ with the planned measurements; what the data predicted and did not show is taken off.
        count: measurements of the plan for a detection probability of 90 %; None where no postures discriminate them.
    """

    rival: Cause
    angle: float
    now: float
    then: float
    count: int | None

    def to_json(self) -> dict[str, Json]:
        """Plain numbers; the angle in rad.

        ``chance`` is the probability that the planned measurements show the difference, `detection_probability`.
        """
        return {
            "kind": self.rival.kind, "target": self.rival.target, "angle": self.angle, "lambda_now": self.now,
            "lambda": self.then, "chance": detection_probability(self.then), "count": self.count,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class DiscriminationPlan:
    """Measurements that discriminate effects from their rivals.

    Args:
        pairs: by the place of the effect in the model, each of its rivals.
        counts: by that place, measurements of the plan after which all but one of effect and rivals are refuted with
            90 %; without those that no postures discriminate, and None where they discriminate none.
        rows: what to measure, the most informative first; none where no postures help.
        rounds: how often all rows are measured.
        sided: the joints whose side of approach matters.
    """

    pairs: Mapping[int, tuple[DiscriminatedPair, ...]]
    counts: Mapping[int, int | None]
    rows: Measurements
    rounds: int
    sided: tuple[int, ...]

    def postures(self, count: int | None = None) -> list[dict[str, Json]]:
        """The first ``count`` postures, with side and payload where they matter [rad, m, kg].

        Args:
            count: how many of the rows; all by default.
        """
        rows, found = self.rows, []
        for i in range(len(rows) if count is None else min(count, len(rows))):
            one: dict[str, Json] = {"posture": dict(zip(rows.joint_names, map(float, rows.q[i]), strict=True))}
            if self.sided:
                one["approach"] = {rows.joint_names[j]: int(rows.approach[i, j]) for j in self.sided}
            if rows.payload is not None:
                one["payload"] = float(rows.payload[i])
            found.append(one)
        return found

    def to_json(self, place: int) -> dict[str, Json]:
        """The entry ``split`` of an effect in ``diagnosis.json``: of the rival that is hardest to refute."""
        pairs = self.pairs[place]
        return {
            "angle": min(s.angle for s in pairs),
            "lambda_now": min(s.now for s in pairs),
            "lambda": min((s.then for s in pairs if s.count is not None), default=None),
            "count": self.counts[place],
            "postures": self.postures(self.counts[place] or 0),
            "rivals": [s.to_json() for s in pairs],
        }


def plan_discrimination(
    problem: ProblemData, linearised: LinearisedData, model: Fit, rivals: Rivals, seed: int = 0
) -> DiscriminationPlan | None:
    """Postures that discriminate the effects of a model from their rivals; None where there are none.

    One list for all pairs, those among the rivals of one effect too, by the largest noncentrality of the pair that is
    hardest to discriminate (`discrimination_design`). Geometry is fitted anew in all of it; its prior is 10 mm and
    1 deg only, so that postures far from the data do not promise too much.

    Args:
        rivals: by the place of an effect in the model, the candidates that could replace it.
        linearised: the data so far; model: the fitted arm with its effects; seed: of the candidate postures.
    """
    discrimination = ModelDiscrimination.of(linearised, model, rivals)
    if not discrimination.all or linearised.sensitivities.residuals.data.position is None:
        return None
    try:
        rows = candidate_rows(
            linearised.sensitivities.residuals, discrimination.joints, bool(discrimination.sided), seed
        )
    except InputError:  # a slide without limits has no room to plan in
        return None
    design, now = discrimination.design(problem, rows)
    far = _lesser_of_directions(
        design.noncentralities(design.after(range(len(rows)), levels.MAX_PLANNED_MEASUREMENTS / max(len(rows), 1)))
    )
    possible = far >= levels.DISCRIMINATED_LAMBDA
    chosen = _choose_postures(design, now, possible)
    steps = list(_growing_plan(design, chosen, possible)) if chosen else []
    places = np.array([place for place, _, _ in discrimination.pairs])
    pairs = _pairs_of_effects(discrimination, now, steps, possible)
    return DiscriminationPlan(
        pairs=pairs,
        counts={place: _needed_count(steps, places == place, possible) for place in pairs},
        rows=rows.take(np.array(chosen, dtype=np.intp)),
        rounds=max(steps[-1][0] // len(chosen), 1) if steps else 1,
        sided=discrimination.sided,
    )


def _pairs_of_effects(
    discrimination: ModelDiscrimination, now: Array, steps: Steps, possible: Mask
) -> dict[int, tuple[DiscriminatedPair, ...]]:
    """By the place of each effect, how well it is discriminated from each of its rivals."""
    found: dict[int, tuple[DiscriminatedPair, ...]] = {}
    for k, rival in enumerate(discrimination.all):
        b = discrimination.pairs.index((rival.place, rival.place, len(discrimination.model.effects) + k))
        then = float(steps[-1][1][b]) if steps else 0.0
        count = _needed_count(steps, np.arange(len(possible)) == b, possible)
        least = float(now[2 * b : 2 * b + 2].min())
        one = DiscriminatedPair(rival.rival.what, rival.angle, least, then, count)
        found[rival.place] = (*found.get(rival.place, ()), one)
    return found


def _choose_postures(design: DiscriminationDesign, now: Array, possible: Mask) -> list[int]:
    """Candidates for the pairs of least λ now; if that leaves others below the target, for these with them."""
    sides = np.flatnonzero(np.repeat(possible, 2))
    asked = [int(k) for k in sides[np.argsort(now[sides])][: levels.PLANNED_PAIRS]]
    chosen: list[int] = []
    for _ in range(levels.PLAN_ATTEMPTS if asked else 0):
        chosen = design.only(asked).chosen(levels.MIN_PLANNED_POSTURES, levels.PLANNED_POSTURES)
        reached = design.noncentralities(design.after(chosen))[sides]
        weak = [int(k) for k in sides[np.argsort(reached)][: levels.PLANNED_PAIRS // 2] if k not in asked]
        if not weak or reached.min() >= levels.DISCRIMINATED_LAMBDA:
            break
        asked += weak
    return chosen


def _growing_plan(design: DiscriminationDesign, chosen: list[int], possible: Mask) -> Iterator[tuple[int, Array]]:
    """(number of measurements, λ (pairs,)) as the plan grows, posture by posture and then round by round."""
    for n in range(min(levels.MIN_PLANNED_POSTURES, len(chosen)), len(chosen) + 1):
        reached = _lesser_of_directions(design.noncentralities(design.after(chosen[:n])))
        yield n, reached
    for rounds in range(2, levels.MAX_PLANNED_MEASUREMENTS // len(chosen) + 1):
        if reached[possible].min() >= levels.DISCRIMINATED_LAMBDA:
            return
        reached = _lesser_of_directions(design.noncentralities(design.after(chosen, rounds)))
        yield rounds * len(chosen), reached


def _needed_count(steps: Steps, asked: Mask, possible: Mask) -> int | None:
    """Measurements that discriminate all pairs that are asked for and possible.

    None where none is, or too many are needed.
    """
    asked = asked & possible
    enough = [count for count, reached in steps if asked.any() and reached[asked].min() >= levels.DISCRIMINATED_LAMBDA]
    return min(enough, default=None)


def _lesser_of_directions(noncentralities: Array) -> Array:
    """(pairs,) the lesser λ of the two directions of each."""
    return np.asarray(np.maximum(noncentralities.reshape(-1, 2).min(axis=1), 0.0))
