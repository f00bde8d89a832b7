"""Every candidate scored by itself on the geometry alone, with the null distribution of the best of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, ScoredCandidate, score_candidates
from posture_opt.diagnosis.scores.score_tests import NullDistribution, ProjectedBaseline
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.shape_refinement import refine_shape


@dataclass(frozen=True, eq=False)
class InitialScores:
    """The data with every candidate scored on the geometry alone, the least p-value first.

    Args:
        candidates: all but lines; ``scored`` the best shape of each kind and target.
        baseline: the geometry; ``null`` the distribution of the least p-value beyond it.
    """

    linearised: LinearisedData
    candidates: Sequence[Candidate]
    baseline: ProjectedBaseline
    scored: Sequence[ScoredCandidate]
    null: NullDistribution

    @classmethod
    def of(cls, linearised: LinearisedData, candidates: Sequence[Candidate], flips: int | None = None) -> InitialScores:
        """With ``flips`` draws of the null distribution, as many as the data ask for if None."""
        baseline = linearised.baseline(flips=flips)
        scored, null = score_candidates(baseline, candidates, linearised.sensitivities, linearised.lines)
        return cls(linearised, candidates, baseline.undrawn, scored, null)

    @property
    def best_p_value(self) -> float:
        """Family-wise p-value of the best candidate; 1 without any."""
        return self.scored[0].p_value if self.scored else 1.0

    def decided(self) -> InitialScores:
        """A close decision with more draws of the null, so that it does not depend on the draw.

        Close is within a factor of `levels.CLOSE_DECISION_FACTOR` of the level, on either side.
        """
        close = self.best_p_value > levels.FIRST_EFFECT_LEVEL / levels.CLOSE_DECISION_FACTOR
        close &= self.best_p_value < levels.FIRST_EFFECT_LEVEL * levels.CLOSE_DECISION_FACTOR
        if not self.scored or not close or len(self.linearised.r) >= levels.MAX_REDRAWN_RESIDUALS:
            return self
        return InitialScores.of(self.linearised, self.candidates, levels.SIGN_FLIPS_FACTOR * self.linearised.flips)

    def null_beside(self, members: Sequence[Candidate]) -> NullDistribution:
        """The distribution of the least p-value beyond the geometry and the members of a set.

        What a large effect leaves in flipped data is no noise: beside it the null has tails that no further effect of
        usual size reaches. Residuals of the whole set have none of it.

        Source: ter Braak (1992), permutation of residuals of the full model.
        """
        linearised = self.linearised
        baseline = linearised.baseline(members, flips=min(linearised.flips, levels.SIGN_FLIPS_OF_MANY_ROWS))
        return score_candidates(baseline, self.candidates, linearised.sensitivities, linearised.lines)[1]

    @cached_property
    def shortlist(self) -> tuple[Candidate, ...]:
        """The candidates that explain something by themselves, those with a searched shape at their best.

        Refining costs some evaluations each: only candidates with a good part of the best evidence, and the first few,
        are.
        """
        refined = levels.REFINED_EVIDENCE_SHARE * self.scored[0].log_p if self.scored else 0.0
        return tuple(
            refine_shape(self.linearised.sensitivities, self.baseline, s.candidate)
            if s.log_p < refined or k < levels.ALWAYS_REFINED_CANDIDATES
            else s.candidate
            for k, s in enumerate(self.scored)
            if s.log_p < np.log(levels.SHORTLIST_P_VALUE)
        )
