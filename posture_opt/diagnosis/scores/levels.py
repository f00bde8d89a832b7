"""Every level, threshold, penalty and count of a diagnosis, once, each with its source.

Three kinds of source: a publication, named by author and year; running time or taste, where the text says so; and two
ablations on simulated arms, whose simulator shares no code with this package and whose draws chose no value.

* "Ablation A" is the first table of ``docs/concepts/ablation.md``, ``python -m benchmarks.ablation --seed 31``: 24
  draws (16 with one or two effects of noncentrality λ ≥ 25, four outside the catalogue, four without effect) and three
  real arms (Barrett WAM, KUKA iiwa 14, Franka Panda), one value changed at a time.
* "Ablation B" is its second table, ``python -m benchmarks.decision_ablation --seed 83``: one draw of each of 13
  families (effects in five kinds of sessions, four kinds of noise, one wrong geometric parameter, two shapes
  outside the catalogue, one arm without effect), each value halved and doubled. "No change" says that verdict,
  causes, rivals and statuses of all 13 diagnoses stayed the same.

No change in either ablation says that a value is not critical within a factor of two, not that it does nothing.
Tolerances of floating point stay where they are used.
"""

from __future__ import annotations

from collections.abc import Mapping

# Error level of the whole diagnosis: 5 %, shared out between its tests (Bonferroni; Miller 1981).
FIRST_EFFECT_LEVEL = 0.015
"""Family-wise level of the first effect of a search: 30 % of the 5 %. Ablation A, halved and doubled: no change."""
FURTHER_EFFECT_LEVEL = 0.006
"""Family-wise level of every effect after the first. Ablation A: halved, the WAM keeps 7 causes in place of 12 and its
held-out RMS rises from 1.69 to 1.78 mm; doubled, one more of 16 draws is named completely."""
SIZE_LEVEL = 0.05
"""Level at which a size is none: the confidence region of the parameters holds zero; the usual 95 %."""
LACK_OF_FIT_LEVEL = FURTHER_EFFECT_LEVEL
"""Level of both tests for anything left unexplained: that of an effect that was not found. Ablation B: no change."""
GEOMETRY_LEVEL = 0.01
"""Level of the F test for geometric causes: 20 % of the 5 %. Ablation B: no change."""
NOISE_LEVEL = 0.002
"""Family-wise level of the first kind of noise, and of a stated σ. Ablation B: no change."""
FURTHER_NOISE_LEVEL = NOISE_LEVEL / 2
"""Level of noise in addition to a cause that is named already (two tests share it, Bonferroni). Ablation B: no change.
"""
UNNAMED_FAMILY = "unnamed"
"""The family of unnamed components; each effect states its own."""
FAMILY_SHARES: Mapping[str, float] = {"named": 0.66, "steps": 0.1, UNNAMED_FAMILY: 0.12, "periodic": 0.12}
"""Share of the level for each family of candidates (weighted Bonferroni; Genovese, Roeder, Wasserman 2006).

Ten times the shapes cost a family ``log 10`` of evidence, half the level only ``log 2``: the few named ones get most.
Ablation A: equal shares raise the held-out RMS of the WAM from 1.69 to 1.80 mm; nothing else moves.
"""

# Draws of null distributions: 99 or 399 make 5 % tests exact (Davison, Hinkley 1997, section 4.2.5).
SIGN_FLIPS = 299
"""Sign-flipped data sets of a search: ``300 · 5 %`` is whole. Ablation A, 99: one more of 16 draws named completely."""
SIGN_FLIPS_OF_MANY_ROWS = 99
"""The same for `MANY_ROWS`, where p-values are far from their level; ablation A, as `SIGN_FLIPS`."""
MANY_ROWS = 3000
"""Rows from which on there are fewer draws; chosen for time."""
MAX_SEARCHED_ROWS = 4_000
"""Rows that are searched by default; chosen for time, on the UR10's series A of 11 911 rows, where 4 000 name the same
arm's causes as 10 000 in the same order, and predict the rows left out to 0.113 mm in place of 0.108.
"""
CLOSE_DECISION_FACTOR = 8.0
"""A best p-value within this factor of its level is drawn again. Ablation A, never drawn again: no change."""
SIGN_FLIPS_FACTOR = 4
"""So many times the sign flips for a close decision: half the sampling error. Ablation B, 1 and 8: no change."""
MAX_REDRAWN_RESIDUALS = 2000
"""Residuals from which on a close decision is not drawn again; chosen for time."""
NOISE_DRAWS = 399
"""Data sets of turned and shuffled repeats behind a p-value of uneven noise; chosen for time."""
TAIL_SHARE = 0.1
"""Share of the draws that the exponential tail is fitted to (Pickands 1975). Ablation B: no change."""
COUNTED_EXCEEDANCES = 10
"""Exceedances from which on a p-value is counted and not extrapolated (Knijnenburg et al. 2009)."""

# Criterion of subset selection: m log(RSS / m) and a penalty for each candidate.
LARGE_GROUP_SIZE = 4
"""Parameters beyond which a group is charged as a group (George, Foster 2000). Ablation A, 2 and 1000: no change."""
CHOICE_PENALTY = 5.0
"""Penalty of any candidate: the logarithm of how many there are (extended BIC; Chen, Chen 2008, γ = 1/2)."""
UNNAMED_PENALTY = CHOICE_PENALTY
"""Further penalty of an unnamed component, as of a second choice. Ablation A, 0 and 10: no change."""
UNLIKELY_PENALTY = CHOICE_PENALTY
"""Further penalty of bending and of a compliant base where no masses are stated: joints are most of an arm's compliance
(Dumas, Caro, Garnier, Furet 2011). Chosen on kuka_14, panda_3 and UR10 series D: without it the held-out RMS of D rises
from 0.158 to 0.195 mm, and nothing else moves."""
LENIENT_PENALTY = 2.0
"""Penalty of a parameter of a rival (Akaike 1974): what only costs more has not been refuted by data."""
RIVAL_CRITERION = 6.0
"""Explanations within it of the criterion cannot be distinguished: an evidence ratio of e³ (Kass, Raftery 1995)."""
MIN_RIVAL_COSINE = 0.5
"""Cosine of the least angle (60°) beyond which candidates are rivals. Ablation A, 0.25 and 0.9: no change."""
MIN_DISTINCT_SHARE = 0.01
"""Share of a candidate that the chosen ones must leave: with less it is another mixture of them. Ablation A: a fifth
and five times both raise the held-out RMS of the WAM (1.69 to 1.81 and 1.91 mm); five times that of all three arms."""

# The chosen set.
MAX_EFFECTS = 40
"""Effects of one model; chosen for time."""
MAX_EXCHANGED_EFFECTS = 12
"""Effects up to which members of a set are exchanged, and their lines fitted together at each step; chosen for time."""
PERSISTENT_SHARE = 0.9
"""Share of what all named effects explain of rows left out, at which those that outlast the session are the model:
fields and slips imitate what has another cause; chosen on the real sets UR5 and kuka_14."""
PLAUSIBLE_SHARE = 0.85
"""Share of what named effects explain of rows left out, at which others replace those of a size that no arm has.
Chosen on 6 vertical drifts of a UR10 in the simulator of `tests.hidden`, judged on 12 others."""
MAX_LINE_FIT_RESIDUALS = 2000
"""Residuals up to which the lines of a pursuit are fitted together after each step; chosen for time."""
MIN_EFFECT_SHARE = 0.02
"""Share of all that the effects explain, below which one of them is not worth its name; a choice of taste."""
MIN_EFFECT_RISE = 0.06
"""Rise of the sum of squares, 3 % of the RMS, with which it is worth its name all the same; a choice of taste."""
FURTHER_FOLD_EFFECTS = 10
"""Effects that a fold pursues beyond those that are significant in all rows, to eliminate from; chosen for time."""
SELECTION_FOLDS = 5
"""Folds of the cross-validation that says how many effects predict (Kohavi 1995)."""
SHORTLIST_P_VALUE = 0.2
"""p-value of its own below which a candidate is shortlisted. Ablation A, 0.02 and 1: no change."""
REFINED_EVIDENCE_SHARE = 0.15
"""Share of the best log p-value from which on the shape of a candidate is refined; chosen for time."""
ALWAYS_REFINED_CANDIDATES = 12
"""Candidates whose shape is always refined; chosen for time."""
NAMED_SHARE = 0.85
"""Share of what the best description explains, at which named effects alone are the model. Ablation A, 0.7 and 0.95: no
change."""

# Candidates and their shapes.
MIN_SURVIVING_SHARE = 0.02
"""Share of a candidate's length that the projection off the geometry must leave. Ablation A: no change."""
PERIODOGRAM_PEAKS = 4
"""Frequencies of one joint that are candidates. Ablation B, 2 and 8: no change."""
MAX_COMPARED_SHAPES = 50
"""Shapes of one effect whose correlation is taken: more, closer together, count no more; chosen for time."""
MIN_SEARCHED_SHAPES = 8.0
"""Shapes that a fitted shape counts as at the least: it is a parameter too. Ablation A, 1: the held-out RMS of the WAM
falls from 1.69 to 1.64 mm; one arm is too few to lower it on."""
MIN_MASS_SINGULAR_VALUE = 0.05
"""Least singular value of unit columns of point masses that are distinct. Ablation A, 0.2: the held-out RMS of kuka_14
rises from 0.159 to 0.241 mm; 0.01: that of the WAM falls from 1.69 to 1.65 mm."""
SHAPE_EVALUATIONS = 16
"""Evaluations of a bounded search for a shape (Brent 1973); chosen for time."""
MIN_LINE_DISTANCE = 1.5
"""Steps of the grid of lines within which a second one is no other line: half of what the range of a joint resolves."""
SHAPES_BETWEEN = 7
"""Shapes between the neighbours on the grid that a fold tries; chosen for time."""
MOMENTS_TRIED = 24
"""Moments of a step that are tried before those next to the best; chosen for time."""

# Unnamed components: their grids. Ablation B, each of the four kinds halved and doubled as a whole: no change.
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
MIN_REPEAT_FREEDOM = 12
"""Degrees of freedom ν of repeats from which on they are a test of anything: σ is known to ``1/√(2ν) = 20 %`` (JCGM
100:2008, equation E.7). Ablation B: no change."""
MAX_KERNEL_ROWS = 1200
"""Rows of a kernel: more are thinned out; chosen for time."""
JOINT_KERNEL_WIDTHS = (0.5, 0.15)
"""Widths of the kernels over a joint in its range: a bow and a bump. Ablation B: no change."""
FIELD_KERNEL_WIDTHS = (0.5, 0.2)
"""Widths of the kernels over the workspace in its size. Ablation B: no change."""
INPUT_KERNEL_WIDTH = JOINT_KERNEL_WIDTHS[1]
"""Width of the kernel over time, payload and temperature in their range. Ablation B: no change."""

# Noise.
REPEATED_NOISE_LEVEL = 0.01
"""p-value of the noise of one joint between repeats below which they confirm it; it was found in all rows before. A
hundredth of the joints that structure accuses is then called noisy."""
LIKELIER_NOISE = 2.71
"""Twice the log likelihood by which repeats have to prefer an instrument's noise, as all rows have it, to none: the
95 % quantile of one side (Wilks 1938). Chosen on 24 simulated instruments, judged on others."""
MIN_SCATTER_SHARE = 0.3
"""Of the size that all rows have of a joint's noise, the least that is named where repeats have less: below it is a
tenth of the variance. Chosen so that the repeats of the UR10's series D, 0.024 of 0.118 mrad, name none."""
REPEATED_POSTURES = 5
"""Postures to be repeated where repeats are asked for; with `REPEATS` of each they determine a σ to 16 %."""
REPEATS = 5
"""Measurements of each of them; a choice of taste."""
REFUTED_SIZE_LOSS = 6.63
"""Twice the log likelihood that a size of noise may lose between repeats: the 99 % quantile of χ² (Wilks 1938)."""
STATED_SIGMA_RATIO = 1.2
"""A stated σ is true enough within this factor: less is not worth a word; a choice of taste."""
STRUCTURE_LEVEL = SIZE_LEVEL
"""p-value below which structure may be left that swells residuals as a σ stated too small does: the usual 5 %. Ablation
B: no change."""
MAX_OUTLIER_SHARE = 0.1
"""Share of rows up to which gross errors are outliers and not the noise itself (the mixtures of Tukey 1960 go to 10 %).
Ablation B: no change."""
MIN_OUTLIER_RATIO = 4.0
"""Least σ of gross errors over that of the others (the mixture of Tukey 1960 has 3). Ablation B: no change."""

# Geometry.
MAX_NAMED_PARAMETERS = 3
"""Geometric parameters that are named one by one; with more, "many parameters". Ablation B: halved, three parameters of
one draw become "many"; doubled: no change."""
MIN_PARAMETER_SHARE = 1e-3
"""Share of what parameters of its unit do at the most, below which one is no candidate. Ablation B: no change."""

# Model discrimination.
DETECTED_ROOT_LAMBDA = 3.5
"""√λ that is seen every other time at the level of the whole search: the two-sided ``p = 4.7e-4`` of a Gaussian, that
of `FIRST_EFFECT_LEVEL` over some thirty independent candidates. Ablation B, on the planned
draw: it scales the size of a plan (50 measurements become 9 when it is halved; doubled, 30, as the closer one of two
rivals is given up)."""
DISCRIMINATED_LAMBDA = (DETECTED_ROOT_LAMBDA + 1.2816) ** 2
"""λ that is seen nine times in ten, by the 90 % quantile 1.2816 of a Gaussian: 22.9."""
MAX_DISCRIMINATED_EFFECTS = 6
"""Effects of a model, those of the largest contribution, that are discriminated from their rivals; chosen for time."""
MAX_DISCRIMINATED_RIVALS = 4
"""Rivals of an effect that it is discriminated from; chosen for time."""
MEAN_PAIR_WEIGHT = 1e-2
"""Weight of the mean over all pairs next to the weakest, which decides between equals. Ablation B: no change."""
EXCHANGE_SWEEPS = 2
"""Sweeps of the exchange of a design (Fedorov 1972); chosen for time."""
PLANNED_POSTURES = 10
"""Postures of a plan; more measurements are rounds of them; a choice of taste."""
MIN_PLANNED_POSTURES = 5
"""Postures of a plan at the least, so that no single reading decides; a choice of taste."""
MAX_PLANNED_MEASUREMENTS = 300
"""What takes more measurements is no matter of postures; a choice of taste."""
PLANNED_PAIRS = 12
"""Pairs, the weakest, that a plan is made for at first; chosen for time."""
PLAN_ATTEMPTS = 3
"""Plans that are made, each for the pairs too that the one before left weak; chosen for time."""
