"""The loop of :mod:`posture_opt.selection.search.local_search` as C text, and what both ways of running it agree on."""

from __future__ import annotations

from posture_opt.collision import contacts_c
from posture_opt.collision.contacts import MOST_NEAR, POINTS
from posture_opt.selection.search import quadratic_model_c
from posture_opt.selection.search.quadratic_model import INFINITE_BOUND

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
    contacts_c.C_TEXT
    + quadratic_model_c.C_TEXT
    + """
/* Where a search stands: m rows of the program, then those of the contacts, then the n variables. */
typedef struct {
  long long n, rows, m;
  double f, *value, *low, *high;
  po_contact* contacts;
} po_point;

static void po_visit(po_point* at, po_memory* values_memory, po_scene* scene, const double* x, const double* given) {
  po_memory* v = values_memory;
  long long i;
  v->arg[0] = x; v->arg[1] = given;
  v->res[0] = &at->f; v->res[1] = at->value; v->res[2] = at->low; v->res[3] = at->high;
  values(v->arg, v->res, v->iw, v->w, 0);
  at->m = at->rows;
  if (scene->pairs) { po_place(scene, x); at->m += po_contacts(scene, NEAR, at->contacts); }
  for (i = at->rows; i < at->m; ++i) {
    const po_contact* c = at->contacts + i - at->rows;
    at->value[i] = c->distance; at->low[i] = c->least; at->high[i] = ENDLESS;
  }
  for (i = 0; i < at->n; ++i) at->value[at->m + i] = x[i];
}

static double po_merit_at(const po_point* at, const double* y, const double* of_contacts, double* spare) {
  long long i;
  for (i = 0; i < at->m; ++i) spare[i] = i < at->rows ? y[i] : of_contacts[at->contacts[i - at->rows].id];
  return po_merit(at->m, at->f, at->value, at->low, at->high, spare);
}

long long posture_opt_loop(long long rows, long long n, long long own, double* q, double* state,
    const double* parameters, long long parameter_step, const double* request, long long request_step,
    const double* lower, const double* upper, long long steps, double stationary, double met, double* result,
    long long capsules, long long pairs, const double* turns, const double* moved, const double* radii,
    const double* pair, const double* solid, double reach) {
  po_memory value = {0}, slope = {0}, curvature = {0}, ik = {0};
  po_scene scene = {n, capsules, pairs, turns, moved, radii, pair, solid, reach};
  po_model s;
  long long failed = 0, row, i, j, step, most = own + (pairs ? NEAR : 0), size = most + n, ids = POINTS * pairs;
  double* modelled = po_model_open(&s, n, most);
  double* space = malloc((4 * n + 10 * size + ids + 8) * sizeof *space);
  po_contact* contacts = malloc((2 * NEAR + 1) * sizeof *contacts);
  if (!space || !modelled || !contacts || !po_open(&value, values_work) || !po_open(&slope, slopes_work)
      || !po_open(&curvature, hessian_work) || !po_open(&ik, restore_work) || !po_scene_open(&scene)) failed = -1;
  for (row = 0; row < rows && !failed; ++row) {
    double *x = space, *p = x + n, *back = p + n, *spare = back + n, *y = spare + n, *next = y + size;
    double *weights = next + size, *full = weights + size, *store = full + ids;
    po_point here = {n, own, own, 0, store, store + size, store + 2 * size, contacts};
    po_point there = {n, own, own, 0, store + 3 * size, store + 4 * size, store + 5 * size, contacts + NEAR};
    double *base = q + row * n, *kept = state + row * (own + n + ids + 1), *out = result + 5 * row;
    double *kept_bounds = kept + own, *kept_contacts = kept_bounds + n;
    const double *given = parameters + row * parameter_step;
    double distance, furthest, longest, radius = kept_contacts[ids], least;
    long long still = 0;
    int indefinite;
    for (i = 0; i < ids; ++i) full[i] = 0;
    po_visit(&here, &value, &scene, base, given);
    for (step = 0; step < steps;) {
      long long m = here.m, k = m - own;
      ++step;
      s.m = m;
      for (i = 0; i < m; ++i) {
        s.low[i] = here.low[i]; s.high[i] = here.high[i];
        y[i] = i < own ? kept[i] : kept_contacts[here.contacts[i - own].id];
      }
      for (j = 0; j < n; ++j) {
        s.low[m + j] = fmax(lower[j], -ENDLESS); s.high[m + j] = fmin(upper[j], ENDLESS); y[m + j] = kept_bounds[j];
      }
      slope.arg[0] = base; slope.arg[1] = given; slope.res[0] = s.slope; slope.res[1] = s.A;
      slopes(slope.arg, slope.res, slope.iw, slope.w, 0);
      if (k) po_place(&scene, base);
      for (i = 0; i < k; ++i) po_contact_slope(&scene, here.contacts + i, s.A + (own + i) * n);
      po_working_set(&s, here.value, y);
      po_orthonormal(&s);
      po_multipliers(&s, s.slope, next);
      for (i = 0; i < m; ++i) weights[i] = fmin(fmax(next[i], -LARGEST), LARGEST);
      curvature.arg[0] = base; curvature.arg[1] = given; curvature.arg[2] = weights; curvature.res[0] = s.H;
      hessian(curvature.arg, curvature.res, curvature.iw, curvature.w, 0);
      po_contact_curvature(&scene, base, here.contacts, weights + own, k, s.A + own * n, spare, s.H);
      po_normal(&s); po_free(&s); po_curvature(&s);
      indefinite = po_step(&s, INFINITY, p);
      out[3] = indefinite ? ENDLESS : 0;
      for (j = 0; j < n && !indefinite; ++j) {
        double pull = s.slope[j] + po_dot(n, s.H + j * n, p) / 2;
        for (i = 0; i < m; ++i) pull += s.A[i * n + j] * next[i];
        out[3] -= pull * p[j];
      }
      po_signed(&s, next);
      for (out[1] = 0, i = 0; i < m; ++i)
        out[1] = fmax(out[1], fmax(s.low[i] - here.value[i], here.value[i] - s.high[i]));
      for (out[2] = 0, j = 0; j < n; ++j) {
        double left = s.slope[j] + next[m + j];
        for (i = 0; i < m; ++i) left += s.A[i * n + j] * next[i];
        out[2] = fmax(out[2], fabs(left));
      }
      for (i = 0; i < m + n; ++i) if (s.equal[i] == 0) out[2] = fmax(out[2], fabs(next[i] * s.gap[i]));
      out[0] = here.f;
      if (out[2] <= stationary && out[1] <= met) break;
      for (;;) {
        po_step(&s, radius, p);
        po_advance(&s, here.value, y, p, next);
        for (j = 0; j < n; ++j) back[j] = fmin(fmax(base[j] + p[j], lower[j]), upper[j]);
        ik.arg[0] = back; ik.arg[1] = request + row * request_step; ik.res[0] = x; ik.res[1] = &distance;
        restore(ik.arg, ik.res, ik.iw, ik.w, 0);
        po_visit(&there, &value, &scene, x, given);
        for (i = 0; i < k; ++i) full[here.contacts[i].id] = next[own + i];
        least = po_merit_at(&here, next, full, weights);
        distance = po_merit_at(&there, next, full, weights);
        if (distance <= least + NO_WORSE * fmax(1, fabs(least)) + fmin(PRICE * out[1], MOST)) { longest = -1; break; }
        for (longest = 0, j = 0; j < n; ++j) longest = fmax(longest, fabs(p[j]));
        radius = LESS * fmin(radius, longest);
        if (!(radius >= SHORTEST)) break;
      }
      for (i = 0; i < k; ++i) full[here.contacts[i].id] = 0;
      if (longest >= 0) break;
      radius = fmin(RADIUS, MORE * radius);
      for (furthest = 0, j = 0; j < n; ++j) furthest = fmax(furthest, fabs(x[j] - base[j]));
      for (i = 0; i < ids; ++i) kept_contacts[i] = 0;
      for (i = 0; i < own; ++i) kept[i] = next[i];
      for (i = 0; i < k; ++i) kept_contacts[here.contacts[i].id] = next[own + i];
      for (j = 0; j < n; ++j) { base[j] = x[j]; kept_bounds[j] = next[m + j]; }
      { const po_point left = here; here = there; there = left; }
      still = furthest > STANDSTILL ? 0 : still + 1;
      if (still == STILL) break;
    }
    out[4] = (double)step; kept_contacts[ids] = radius;
  }
  free(space); free(modelled); free(contacts); po_close(&value); po_close(&slope); po_close(&curvature); po_close(&ik);
  po_scene_close(&scene);
  return failed;
}
""".replace("ENDLESS", repr(INFINITE_BOUND))
    .replace("NEAR", repr(MOST_NEAR))
    .replace("POINTS", repr(POINTS))
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
