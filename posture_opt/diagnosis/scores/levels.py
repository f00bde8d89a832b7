"""Every level, threshold, penalty and count of a diagnosis, once, each with its source.

Where no author is named the value was chosen on simulated draws, none of them real data; an ablation on data that it
was not tuned on is pending. Tolerances of floating point stay where they are used.
"""

from __future__ import annotations

from collections.abc import Mapping

# Error level of the whole diagnosis: 5 %, shared out between its tests (Bonferroni; Miller 1981).
FIRST_EFFECT = 0.015
"""Family-wise level of the first effect of a search; chosen on simulated draws, ablation pending."""
FURTHER_EFFECT = 0.006
"""Family-wise level of every effect after the first; chosen on simulated draws, ablation pending."""
SIZE = 0.05
"""Level at which a size is none: the confidence region of the parameters holds zero; the usual 95 %."""
LACK_OF_FIT = 0.006
"""Level of both tests for anything left unexplained; chosen on simulated draws, ablation pending."""
GEOMETRY = 0.01
"""Level of the F test for geometric causes; chosen on simulated draws, ablation pending."""
NOISE = 0.002
"""Family-wise level of the first kind of noise, and of a stated σ; chosen on simulated draws, ablation pending."""
NOISE_BESIDE_A_CAUSE = 0.001
"""Level of noise beside a cause that is named already; chosen on simulated draws, ablation pending."""
UNNAMED = "unnamed"
"""The family of unnamed components; those of effects stand with each effect."""
FAMILY_SHARES: Mapping[str, float] = {"named": 0.66, "steps": 0.1, UNNAMED: 0.12, "periodic": 0.12}
"""Share of the level for each family of candidates (weighted Bonferroni; Genovese, Roeder, Wasserman 2006).

Ten times the shapes cost a family ``log 10`` of evidence, half the level only ``log 2``: the few get most of it.
Chosen on simulated draws, ablation pending.
"""

# Draws of null distributions: 99 or 399 make 5 % tests exact (Davison, Hinkley 1997, section 4.2.5).
SIGN_FLIPS = 299
"""Sign-flipped data sets of a search; chosen on simulated draws, ablation pending."""
SIGN_FLIPS_OF_MANY_ROWS = 99
"""The same where nothing hangs on the last digit of a p-value; chosen on simulated draws, ablation pending."""
MANY_ROWS = 3000
"""Rows from which on there are fewer draws; chosen for time."""
MOST_ROWS = 10_000
"""Rows that are searched by default; chosen for time: there, an effect of a hundredth of the scatter is found."""
CLOSE_DECISION = 8.0
"""A best p-value within this factor of its level is drawn again; chosen on simulated draws, ablation pending."""
MORE_SIGN_FLIPS = 4
"""So many times the sign flips for a close decision; chosen on simulated draws, ablation pending."""
STEADY_RESIDUALS = 2000
"""Residuals from which on a close decision is not drawn again; chosen for time."""
NOISE_DRAWS = 399
"""Data sets of turned and shuffled repeats behind a p-value of uneven noise; chosen for time."""
TAIL_SHARE = 0.1
"""Share of the draws that the exponential tail is fitted to (Pickands 1975; the share chosen on simulated draws)."""
COUNTED_DRAWS = 10
"""Exceedances from which on a p-value is counted and not extrapolated (Knijnenburg et al. 2009)."""

# Criterion of subset selection: m log(RSS / m) and a penalty for each candidate.
LARGE_GROUP = 4
"""Parameters beyond which a group is charged as a group; chosen on simulated draws, ablation pending."""
PENALTY_OF_A_CHOICE = 5.0
"""Penalty of any candidate: the logarithm of how many there are (extended BIC; Chen, Chen 2008, γ = 1/2)."""
PENALTY_WITHOUT_A_NAME = 5.0
"""Further penalty of an unnamed component; chosen on simulated draws, ablation pending."""
LENIENT_PENALTY = 2.0
"""Penalty of a parameter of a rival (Akaike 1974): what only costs more has not been refuted by data."""
RIVAL_CRITERION = 6.0
"""Explanations within it of the criterion cannot be told apart: an evidence ratio of e³ (Kass, Raftery 1995)."""
RIVAL_COSINE = 0.5
"""Cosine of the least angle beyond which candidates are rivals; chosen on simulated draws, ablation pending."""
DISTINCT_SHARE = 0.01
"""Share of a candidate that the chosen ones must leave: with less it is another mixture of them; chosen on simulated
draws, ablation pending."""

# The chosen set.
MOST_EFFECTS = 40
"""Effects of one model; chosen for time."""
EXCHANGED_EFFECTS = 12
"""Effects up to which members of a set are exchanged, and their lines fitted together at each step; chosen for time."""
LASTING_EXPLAIN_ENOUGH = 0.9
"""Share of what all named effects explain of rows left out, at which those that outlast the session are the model:
fields and slips imitate what has another cause; chosen on the real sets UR5 and kuka_14."""
FITTED_TOGETHER = 2000
"""Residuals up to which the lines of a pursuit are fitted together after each step; chosen for time."""
LEAST_SHARE = 0.02
"""Share of all that the effects explain, below which one of them is not worth its name; a choice of taste."""
LEAST_RISE = 0.06
"""Rise of the sum of squares, 3 % of the RMS, with which it is worth its name all the same; a choice of taste."""
FURTHER_IN_FOLDS = 10
"""Effects that a fold pursues beyond those that are significant in all rows, to eliminate from; chosen for time."""
SELECTION_FOLDS = 5
"""Folds of the cross-validation that says how many effects predict (Kohavi 1995)."""
SHORTLIST_P_VALUE = 0.2
"""p-value of its own below which a candidate is shortlisted; chosen on simulated draws, ablation pending."""
REFINED_EVIDENCE = 0.15
"""Share of the best log p-value from which on the shape of a candidate is refined; chosen for time."""
ALWAYS_REFINED = 12
"""Candidates whose shape is always refined; chosen for time."""
NAMES_EXPLAIN_ENOUGH = 0.85
"""Share of what the best description explains, at which named effects alone are the model; chosen on simulated draws,
ablation pending."""

# Candidates and their shapes.
SURVIVING_SHARE = 0.02
"""Share of a candidate's length that the projection off the geometry must leave; chosen on simulated draws, ablation
pending."""
PERIODOGRAM_PEAKS = 4
"""Frequencies of one joint that are candidates; chosen on simulated draws, ablation pending."""
COMPARED_SHAPES = 50
"""Shapes of one effect whose correlation is taken: more, closer together, count no more; chosen for time."""
SHAPES_OF_A_PARAMETER = 8.0
"""Shapes that a fitted shape counts as at the least: it is a parameter too; chosen on simulated draws, ablation
pending."""
DISTINCT_MASSES = 0.05
"""Least singular value of unit columns of point masses that are told apart; chosen on simulated draws, ablation
pending."""
SHAPE_EVALUATIONS = 16
"""Evaluations of a bounded search for a shape (Brent 1973); chosen for time."""
LEAST_LINE_DISTANCE = 1.5
"""Steps of the grid of lines within which a second one is no other line: half of what the range of a joint resolves."""
SHAPES_BETWEEN = 7
"""Shapes between the neighbours on the grid that a fold tries; chosen for time."""
MOMENTS_TRIED = 24
"""Moments of a step that are tried before those beside the best; chosen for time."""

# Unnamed components: their grids; chosen on simulated draws, ablation pending.
CURVE_BUMPS = 8
"""Radial bases over the range of a joint."""
COURSE_BUMPS = 5
"""Radial bases over time."""
BUMP_WIDTH = 0.7
"""Standard deviation of a radial basis in distances to the next."""
DENT_WIDTHS = (0.15, 0.35)
"""Standard deviations of a dent in the error of a joint [rad]."""
DENT_SPACING = 1.5
"""Distance of neighbouring dents in their widths."""
DENT_COUNT = (4, 24)
"""Dents over the range of a joint, at the least and at the most."""
DENT_ROWS = 4
"""Rows that must lie where a dent is at least 0.3 of its depth."""
SQUARE_WAVES = range(1, 7)
"""Periods of a square wave in one turn of a joint."""
SQUARE_WAVE_PHASES = 8
"""Phases of a square wave."""
SQUARE_WAVE_FINER = 4
"""Steps from a phase of the grid to half way to the next, when a square wave is refined."""
CONSTANT_WAVE = 0.95
"""Mean size from which on a square wave is a constant over the data."""
FIELD_WAVELENGTHS = (0.2, 0.3, 0.45)
"""Wavelengths over the workspace in its sizes."""

# Lack of fit.
REPEAT_FREEDOM = 12
"""Degrees of freedom of repeats from which on they are a test of anything; chosen on simulated draws, ablation
pending."""
KERNEL_ROWS = 1200
"""Rows of a kernel: more are thinned out; chosen for time."""
JOINT_KERNELS = (0.5, 0.15)
"""Widths of the kernels over a joint in its range; chosen on simulated draws, ablation pending."""
FIELD_KERNELS = (0.5, 0.2)
"""Widths of the kernels over the workspace in its size; chosen on simulated draws, ablation pending."""
INPUT_KERNEL = 0.15
"""Width of the kernel over time, payload and temperature in their range; chosen on simulated draws, ablation
pending."""

# Noise.
NOISE_IN_REPEATS = 0.01
"""p-value of the noise of one joint between repeats below which they confirm it; it was found in all rows before. A
hundredth of the joints that structure accuses is then called noisy."""
REPEATED_POSTURES = 5
"""Postures to be repeated where repeats are asked for; with `REPEATS` of each they tell a σ to 16 %."""
REPEATS = 5
"""Measurements of each of them; a choice of taste."""
REFUTED_BY_REPEATS = 6.63
"""Twice the log likelihood that a size of noise may lose between repeats: the 99 % quantile of χ² (Wilks 1938)."""
STATED_SIGMA_RATIO = 1.2
"""A stated σ is true enough within this factor: less is not worth a word; a choice of taste."""
STRUCTURE_IN_DOUBT = 0.05
"""p-value below which structure may be left that swells residuals as a σ stated too small does; chosen on simulated
draws, ablation pending."""
OUTLIER_SHARE = 0.1
"""Share of rows up to which gross errors are outliers and not the noise itself; chosen on simulated draws, ablation
pending."""
OUTLIER_RATIO = 4.0
"""Least σ of gross errors over that of the others (the mixture of Tukey 1960 has 3); chosen on simulated draws,
ablation pending."""

# Geometry.
FEW_PARAMETERS = 3
"""Geometric parameters that are named one by one; chosen on simulated draws, ablation pending."""
SLIGHT_PARAMETER = 1e-3
"""Share of what parameters of its unit do at the most, below which one is no candidate; chosen on simulated draws,
ablation pending."""

# Model discrimination.
DETECTED = 3.5
"""√λ that is seen every other time at the level of the whole search: ``p ≈ 5e-4``; chosen on simulated draws, ablation
pending."""
DISCRIMINATED = (DETECTED + 1.2816) ** 2
"""λ that is seen nine times in ten, by the 90 % quantile 1.2816 of a Gaussian: 22.9."""
DISCRIMINATED_EFFECTS = 6
"""Effects of a model, the weightiest, that are told from their rivals; chosen for time."""
DISCRIMINATED_RIVALS = 4
"""Rivals of an effect that it is told from; chosen for time."""
MEAN_WEIGHT = 1e-2
"""Weight of the mean over all pairs beside the weakest, which decides between equals; chosen on simulated draws,
ablation pending."""
EXCHANGE_SWEEPS = 2
"""Sweeps of the exchange of a design (Fedorov 1972); chosen for time."""
PLANNED_POSTURES = 10
"""Postures of a plan; more measurements are rounds of them; a choice of taste."""
FEWEST_POSTURES = 5
"""Postures of a plan at the least, so that no single reading decides; a choice of taste."""
MOST_MEASUREMENTS = 300
"""What takes more measurements is no matter of postures; a choice of taste."""
PLANNED_PAIRS = 12
"""Pairs, the weakest, that a plan is made for at first; chosen for time."""
PLAN_ATTEMPTS = 3
"""Plans that are made, each for the pairs too that the one before left weak; chosen for time."""
