"""The loop of :mod:`posture_opt.selection.search.local_search` as C text, and what both ways of running it agree on."""

from __future__ import annotations

from posture_opt.selection.search.quadratic_model import INFINITE_BOUND
from posture_opt.selection.search.quadratic_model_c import C_TEXT

MET = 1e-9
"""Largest violation of a row [m, rad or 1] of a posture that counts as optimal, as IPOPT is asked for."""
LONGEST_STEP = 0.5
"""Radius [rad or m] of a step at first and at most: the quadratic model of a rotation means nothing beyond."""
SMALLER = 0.25  # times a step that made the merit worse: the next radius
LARGER = 4.0  # times a radius whose step was taken: the next one
MERIT_TOLERANCE = 1e-7  # of the merit: its rounding
VIOLATION_ALLOWANCE = (
    100.0,
    1e-5,
)  # of the merit for each m or rad of violation, and at most: what the last digits of rows cost
STANDSTILL_STEP = 1e-12  # rad or m: a step that moves no joint further is none,
MAX_IDLE_STEPS = 2  # and after two of them, the multipliers settled, no other follows: where rows cannot be met, say
SMALLEST_RADIUS = 1e-5  # rad or m: what is no better within it stays where it is
MAX_MULTIPLIER = (
    1e3  # of a multiplier in the Hessian: where the rows nearly depend on each other, estimates are anything
)

LOOP_TEXT = (
    C_TEXT
    + """
long long posture_opt_loop(long long rows, long long n, long long m, double* q, double* y, const double* parameters,
    long long parameter_step, const double* request, long long request_step, const double* lower, const double* upper,
    long long steps, double stationary, double met, double* result) {
  po_memory value = {0}, slope = {0}, curvature = {0}, ik = {0};
  po_model s;
  long long failed = 0, row, i, j, step, size = m + n;
  double* modelled = po_model_open(&s, n, m);
  double* space = malloc((3 * n + 6 * size + 8) * sizeof *space);
  if (!space || !modelled || !po_open(&value, values_work) || !po_open(&slope, slopes_work)
      || !po_open(&curvature, hessian_work) || !po_open(&ik, restore_work)) failed = -1;
  for (row = 0; row < rows && !failed; ++row) {
    double *x = space, *p = x + n, *back = p + n, *here = back + n, *there = here + size, *low = there + size;
    double *high = low + size, *next = high + size, *weights = next + size;
    double *base = q + row * n, *kept = y + row * (size + 1), *out = result + 5 * row;
    const double *given = parameters + row * parameter_step;
    double f, f_there, distance, furthest, longest, radius = kept[size], least;
    long long still = 0;
    int indefinite;
    value.arg[0] = base; value.arg[1] = given; value.res[0] = &f; value.res[1] = here;
    value.res[2] = s.low; value.res[3] = s.high;
    values(value.arg, value.res, value.iw, value.w, 0);
    for (j = 0; j < n; ++j) {
      here[m + j] = base[j]; s.low[m + j] = fmax(lower[j], -ENDLESS); s.high[m + j] = fmin(upper[j], ENDLESS);
    }
    for (step = 0; step < steps;) {
      ++step;
      slope.arg[0] = base; slope.arg[1] = given; slope.res[0] = s.slope; slope.res[1] = s.A;
      slopes(slope.arg, slope.res, slope.iw, slope.w, 0);
      po_working_set(&s, here, kept);
      po_orthonormal(&s);
      po_multipliers(&s, s.slope, next);
      for (i = 0; i < m; ++i) weights[i] = fmin(fmax(next[i], -LARGEST), LARGEST);
      curvature.arg[0] = base; curvature.arg[1] = given; curvature.arg[2] = weights; curvature.res[0] = s.H;
      hessian(curvature.arg, curvature.res, curvature.iw, curvature.w, 0);
      po_normal(&s); po_free(&s); po_curvature(&s);
      indefinite = po_step(&s, INFINITY, p);
      out[3] = indefinite ? ENDLESS : 0;
      for (j = 0; j < n && !indefinite; ++j) {
        double pull = s.slope[j] + po_dot(n, s.H + j * n, p) / 2;
        for (i = 0; i < m; ++i) pull += s.A[i * n + j] * next[i];
        out[3] -= pull * p[j];
      }
      po_signed(&s, next);
      for (out[1] = 0, i = 0; i < m; ++i) out[1] = fmax(out[1], fmax(s.low[i] - here[i], here[i] - s.high[i]));
      for (out[2] = 0, j = 0; j < n; ++j) {
        double left = s.slope[j] + next[m + j];
        for (i = 0; i < m; ++i) left += s.A[i * n + j] * next[i];
        out[2] = fmax(out[2], fabs(left));
      }
      for (i = 0; i < size; ++i) if (s.equal[i] == 0) out[2] = fmax(out[2], fabs(next[i] * s.gap[i]));
      out[0] = f;
      if (out[2] <= stationary && out[1] <= met) break;
      for (;;) {
        po_step(&s, radius, p);
        po_advance(&s, here, kept, p, next);
        for (j = 0; j < n; ++j) back[j] = fmin(fmax(base[j] + p[j], lower[j]), upper[j]);
        ik.arg[0] = back; ik.arg[1] = request + row * request_step; ik.res[0] = x; ik.res[1] = &distance;
        restore(ik.arg, ik.res, ik.iw, ik.w, 0);
        value.arg[0] = x; value.res[0] = &f_there; value.res[1] = there; value.res[2] = low; value.res[3] = high;
        values(value.arg, value.res, value.iw, value.w, 0);
        least = po_merit(m, f, here, s.low, s.high, next);
        if (po_merit(m, f_there, there, low, high, next)
            <= least + NO_WORSE * fmax(1, fabs(least)) + fmin(PRICE * out[1], MOST)) { longest = -1; break; }
        for (longest = 0, j = 0; j < n; ++j) longest = fmax(longest, fabs(p[j]));
        radius = LESS * fmin(radius, longest);
        if (!(radius >= SHORTEST)) break;
      }
      if (longest >= 0) break;
      radius = fmin(RADIUS, MORE * radius);
      for (furthest = 0, j = 0; j < n; ++j) furthest = fmax(furthest, fabs(x[j] - base[j]));
      f = f_there;
      for (j = 0; j < n; ++j) { base[j] = x[j]; here[m + j] = x[j]; }
      for (i = 0; i < m; ++i) { here[i] = there[i]; s.low[i] = low[i]; s.high[i] = high[i]; }
      for (i = 0; i < size; ++i) kept[i] = next[i];
      still = furthest > STANDSTILL ? 0 : still + 1;
      if (still == STILL) break;
    }
    out[4] = (double)step; kept[size] = radius;
  }
  free(space); free(modelled); po_close(&value); po_close(&slope); po_close(&curvature); po_close(&ik);
  return failed;
}
""".replace("ENDLESS", repr(INFINITE_BOUND))
    .replace("NO_WORSE", repr(MERIT_TOLERANCE))
    .replace("SHORTEST", repr(SMALLEST_RADIUS))
    .replace("LESS", repr(SMALLER))
    .replace("MORE", repr(LARGER))
    .replace("LARGEST", repr(MAX_MULTIPLIER))
    .replace("RADIUS", repr(LONGEST_STEP))
    .replace("STANDSTILL", repr(STANDSTILL_STEP))
    .replace("STILL", repr(MAX_IDLE_STEPS))
    .replace("PRICE", repr(VIOLATION_ALLOWANCE[0]))
    .replace("MOST", repr(VIOLATION_ALLOWANCE[1]))
)
"""C text of ``posture_opt_loop``, around the functions ``values``, ``slopes``, ``hessian`` and ``restore``."""
