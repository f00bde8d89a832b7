/* Local search: quadratic model and step for one point at a time, and the loop around them.
 *
 * The same operations in the same order as quadratic_model.py, but for the eigenvalues: here by Jacobi's rotations
 * (Golub and Van Loan 2013, section 8.5), short and exact for the few directions that the rows leave. Around the
 * functions values, slopes, hessian and restore. */

static double po_dot(long long n, const double* a, const double* b) {
  double sum = 0; long long i;
  for (i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

typedef struct {
  long long n, m, k;
  double *low, *high, *work, *above, *equal, *gap, *Q, *L, *Z, *H, *K, *V, *values, *normal, *bent, *slope, *A, *spare;
} po_model;

static double* po_model_open(po_model* s, long long n, long long m) {
  double** part[] = {&s->low, &s->high, &s->work, &s->above, &s->equal, &s->gap, &s->Q, &s->L, &s->Z, &s->H, &s->K,
    &s->V, &s->values, &s->normal, &s->bent, &s->slope, &s->A, &s->spare};
  const long long size[] = {m + n, m + n, m + n, m + n, m + n, m + n, m * n, m * m, n * n, n * n, n * n, n * n, n, n, n,
    n, m * n, 4 * n + 2 * m};
  long long i, total = 1;
  double* space;
  for (i = 0; i < 18; ++i) total += size[i];
  space = malloc(total * sizeof *space);
  for (i = 0, total = 0; i < 18; ++i) { *part[i] = space + total; total += size[i]; }
  s->n = n; s->m = m;
  return space;
}

/* Which ends are in the working set, and how far they are away. */
static void po_working_set(po_model* s, const double* value, const double* y) {
  long long i;
  for (i = 0; i < s->m + s->n; ++i) {
    const int below = y[i] < 0 || value[i] < s->low[i] - WORKING_SET_TOLERANCE;
    s->equal[i] = s->low[i] == s->high[i];
    s->above[i] = s->equal[i] != 0 || y[i] > 0 || value[i] > s->high[i] + WORKING_SET_TOLERANCE;
    s->work[i] = s->above[i] != 0 || below;
    s->gap[i] = s->work[i] != 0 ? (s->above[i] != 0 ? s->high[i] : s->low[i]) - value[i] : 0;
  }
}

/* A = L Q for the rows of the working set, held variables left out; a row that depends on others has a zero pivot. */
static void po_orthonormal(po_model* s) {
  long long n = s->n, m = s->m, i, j, k, pass;
  for (i = 0; i < m; ++i) {
    double *q = s->Q + i * n, *l = s->L + i * m, before, after;
    for (j = 0; j < n; ++j) q[j] = s->work[i] != 0 && s->work[m + j] == 0 ? s->A[i * n + j] : 0;
    for (k = 0; k < m; ++k) l[k] = 0;
    if (s->work[i] == 0) continue;
    before = po_dot(n, q, q);
    for (pass = 0; pass < 2; ++pass) for (k = 0; k < i; ++k) if (s->L[k * m + k] > 0) {
      const double d = po_dot(n, q, s->Q + k * n);
      l[k] += d;
      for (j = 0; j < n; ++j) q[j] -= d * s->Q[k * n + j];
    }
    after = po_dot(n, q, q);
    l[i] = after > DEPENDENT_ROW_TOLERANCE * before && before > 0 ? sqrt(after) : 0;
    for (j = 0; j < n; ++j) q[j] = l[i] > 0 ? q[j] / l[i] : 0;
  }
}

/* The multipliers that leave the least residual with a slope. */
static void po_multipliers(const po_model* s, const double* slope, double* out) {
  long long n = s->n, m = s->m, i, j, k;
  for (i = m - 1; i >= 0; --i) {
    double w = 0;
    if (s->L[i * m + i] > 0) {
      w = -po_dot(n, s->Q + i * n, slope);
      for (k = i + 1; k < m; ++k) w -= s->L[k * m + i] * out[k];
      w /= s->L[i * m + i];
    }
    out[i] = w;
  }
  for (j = 0; j < n; ++j) {
    double w = slope[j];
    for (i = 0; i < m; ++i) if (out[i] != 0) w += s->A[i * n + j] * out[i];
    out[m + j] = s->work[m + j] != 0 ? -w : 0;
  }
}

static void po_signed(const po_model* s, double* y) {
  long long i;
  for (i = 0; i < s->m + s->n; ++i)
    if (s->work[i] == 0) y[i] = 0;
    else if (s->equal[i] == 0) y[i] = s->above[i] != 0 ? fmax(y[i], 0) : fmin(y[i], 0);
}

/* The least step that meets the rows of the working set and the bounds that are held. */
static void po_normal(po_model* s) {
  long long n = s->n, m = s->m, i, j, k;
  double* t = s->spare;
  for (j = 0; j < n; ++j) s->normal[j] = s->gap[m + j];
  for (i = 0; i < m; ++i) {
    double b = s->gap[i];
    t[i] = 0;
    if (!(s->L[i * m + i] > 0)) continue;
    for (j = 0; j < n; ++j) b -= s->A[i * n + j] * s->gap[m + j];
    for (k = 0; k < i; ++k) b -= s->L[i * m + k] * t[k];
    t[i] = b / s->L[i * m + i];
    for (j = 0; j < n; ++j) s->normal[j] += t[i] * s->Q[i * n + j];
  }
}

/* An orthonormal basis of what the working set leaves free: the unit vector that sticks out most, again and again. */
static void po_free(po_model* s) {
  long long n = s->n, m = s->m, i, j, k, rank = 0, held = 0, pass;
  double* out = s->spare;
  for (i = 0; i < m; ++i) rank += s->L[i * m + i] > 0;
  for (j = 0; j < n; ++j) {
    held += s->work[m + j] != 0;
    out[j] = s->work[m + j] != 0 ? -1 : 1;
    for (i = 0; i < m; ++i) out[j] -= s->Q[i * n + j] * s->Q[i * n + j];
  }
  s->k = n - rank - held;
  if (s->k < 0) s->k = 0;
  for (k = 0; k < s->k; ++k) {
    double *z = s->Z + k * n, size;
    long long best = 0;
    for (j = 1; j < n; ++j) if (out[j] > out[best]) best = j;
    for (j = 0; j < n; ++j) z[j] = j == best;
    for (pass = 0; pass < 2; ++pass) for (i = 0; i < m + k; ++i) if (i >= m || s->L[i * m + i] > 0) {
      const double* q = i < m ? s->Q + i * n : s->Z + (i - m) * n;
      const double d = po_dot(n, z, q);
      for (j = 0; j < n; ++j) z[j] -= d * q[j];
    }
    for (j = 0; j < n; ++j) if (s->work[m + j] != 0) z[j] = 0;
    size = sqrt(po_dot(n, z, z));
    for (j = 0; j < n; ++j) { z[j] /= size; out[j] -= z[j] * z[j]; }
    out[best] = -1;
  }
}

/* Eigenvalues of K (k, k), ascending or not, and eigenvectors as rows of V. */
static void po_eigen(long long k, double* K, double* V, double* values) {
  long long i, j, p, q, sweep;
  for (i = 0; i < k * k; ++i) V[i] = i / k == i % k;
  for (sweep = 0; sweep < 40; ++sweep) {
    double off = 0, all = 0;
    for (i = 0; i < k; ++i) for (j = 0; j < k; ++j) {
      const double square = K[i * k + j] * K[i * k + j];
      all += square;
      if (i != j) off += square;
    }
    if (!(off > 1e-30 * all)) break;
    for (p = 0; p < k; ++p) for (q = p + 1; q < k; ++q) {
      const double h = K[p * k + q];
      double theta, t, c, d;
      if (!(fabs(h) > 1e-18 * (fabs(K[p * k + p]) + fabs(K[q * k + q])))) continue;
      theta = (K[q * k + q] - K[p * k + p]) / (2 * h);
      t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
      c = 1 / sqrt(t * t + 1); d = t * c;
      for (i = 0; i < k; ++i) {
        const double a = K[i * k + p], b = K[i * k + q];
        K[i * k + p] = c * a - d * b; K[i * k + q] = d * a + c * b;
      }
      for (i = 0; i < k; ++i) {
        const double a = K[p * k + i], b = K[q * k + i], u = V[p * k + i], v = V[q * k + i];
        K[p * k + i] = c * a - d * b; K[q * k + i] = d * a + c * b;
        V[p * k + i] = c * u - d * v; V[q * k + i] = d * u + c * v;
      }
    }
  }
  for (i = 0; i < k; ++i) values[i] = K[i * k + i];
}

/* The Hessian along what is left free, as eigenvalues and their directions: the rows of Z become these. */
static void po_curvature(po_model* s) {
  long long n = s->n, k = s->k, i, j, l;
  double *hz = s->spare, *V = s->V;
  for (i = 0; i < k; ++i) {
    for (j = 0; j < n; ++j) hz[j] = po_dot(n, s->H + j * n, s->Z + i * n);
    for (j = 0; j < k; ++j) s->K[i * k + j] = po_dot(n, s->Z + j * n, hz);
  }
  po_eigen(k, s->K, V, s->values);
  for (i = 0; i < k; ++i) for (j = 0; j < n; ++j) {
    double sum = 0;
    for (l = 0; l < k; ++l) sum += V[i * k + l] * s->Z[l * n + j];
    s->K[i * n + j] = sum;
  }
  for (i = 0; i < k * n; ++i) s->Z[i] = s->K[i];
  for (j = 0; j < n; ++j) s->bent[j] = po_dot(n, s->H + j * n, s->normal);
}

/* The step within a radius; returns whether the Hessian bends downwards along it. */
static int po_step(const po_model* s, double radius, double* p) {
  long long n = s->n, k = s->k, i, j, it;
  double *c = s->spare, least = INFINITY, most = TINY_CURVATURE, longest = 0, share, shift, floor;
  for (j = 0; j < n; ++j) longest = fmax(longest, fabs(s->normal[j]));
  share = longest > radius ? radius / longest : 1;
  for (i = 0; i < k; ++i) {
    c[i] = 0;
    for (j = 0; j < n; ++j) c[i] += s->Z[i * n + j] * (s->slope[j] + share * s->bent[j]);
    least = fmin(least, s->values[i]); most = fmax(most, fabs(s->values[i]));
  }
  floor = FLAT_CURVATURE * most;
  shift = fmax(0, floor - least);
  for (it = 0; it < MAX_SHIFTS; ++it) {
    double size = 0, slope = 0;
    for (i = 0; i < k; ++i) { const double d = s->values[i] + shift, z = c[i] / d; size += z * z; slope += z * z / d; }
    size = sqrt(size);
    if (!(size > radius * (1 + RADIUS_TOLERANCE))) break;
    shift += (size / radius - 1) * size * size / slope;
  }
  for (j = 0; j < n; ++j) p[j] = share * s->normal[j];
  for (i = 0; i < k; ++i) {
    const double z = -c[i] / (s->values[i] + shift);
    for (j = 0; j < n; ++j) p[j] += z * s->Z[i * n + j];
  }
  return k > 0 && least < -floor;
}

/* The augmented Lagrangian of the rows. */
static double po_merit(long long m, double f, const double* g, const double* low, const double* high, const double* y) {
  long long i;
  for (i = 0; i < m; ++i) {
    const double over = g[i] - high[i], under = low[i] - g[i];
    if (low[i] == high[i]) f += y[i] * over + PENALTY / 2 * over * over;
    else {
      const double upper = fmax(y[i], 0), lower = fmax(-y[i], 0);
      const double above = fmax(over, -upper / PENALTY), below = fmax(under, -lower / PENALTY);
      f += upper * above + PENALTY / 2 * above * above + lower * below + PENALTY / 2 * below * below;
    }
  }
  return f;
}

/* The multipliers of the next working set; p is shortened to what it meets first. */
static void po_advance(const po_model* s, const double* value, const double* before, double* p, double* y) {
  long long n = s->n, m = s->m, i, j;
  double *slope = s->spare + n, *change = slope + n, first = 1;
  for (j = 0; j < n; ++j) slope[j] = s->slope[j] + po_dot(n, s->H + j * n, p);
  po_multipliers(s, slope, y);
  po_signed(s, y);
  for (i = 0; i < m + n; ++i) if (y[i] == 0 && fabs(before[i]) == JOINED_MULTIPLIER)
    y[i] = before[i] > 0 ? JOINED_MULTIPLIER / 2 : -JOINED_MULTIPLIER / 2;
  for (i = 0; i < m + n; ++i) {
    change[i] = i < m ? po_dot(n, s->A + i * n, p) : p[i - m];
    if (s->work[i] == 0 && fabs(change[i]) > LEAST_CHANGE)
      first = fmin(first, fmax(((change[i] > 0 ? s->high[i] : s->low[i]) - value[i]) / change[i], 0));
  }
  for (i = 0; i < m + n; ++i) if (s->work[i] == 0 && fabs(change[i]) > LEAST_CHANGE) {
    const double ratio = fmax(((change[i] > 0 ? s->high[i] : s->low[i]) - value[i]) / change[i], 0);
    if (ratio <= first) y[i] = change[i] > 0 ? JOINED_MULTIPLIER : -JOINED_MULTIPLIER;
  }
  for (j = 0; j < n; ++j) p[j] *= first;
}

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
  if (scene->pairs) { po_place(scene, x); at->m += po_contacts(scene, MOST_NEAR, at->contacts); }
  for (i = at->rows; i < at->m; ++i) {
    const po_contact* c = at->contacts + i - at->rows;
    at->value[i] = c->distance; at->low[i] = c->least; at->high[i] = INFINITE_BOUND;
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
  long long failed = 0, row, i, j, step, most = own + (pairs ? MOST_NEAR : 0), size = most + n, ids = POINTS * pairs;
  double* modelled = po_model_open(&s, n, most);
  double* space = malloc((4 * n + 10 * size + ids + 8) * sizeof *space);
  po_contact* contacts = malloc((2 * MOST_NEAR + 1) * sizeof *contacts);
  if (!space || !modelled || !contacts || !po_open(&value, values_work) || !po_open(&slope, slopes_work)
      || !po_open(&curvature, hessian_work) || !po_open(&ik, restore_work) || !po_scene_open(&scene)) failed = -1;
  for (row = 0; row < rows && !failed; ++row) {
    double *x = space, *p = x + n, *back = p + n, *spare = back + n, *y = spare + n, *next = y + size;
    double *weights = next + size, *full = weights + size, *store = full + ids;
    po_point here = {n, own, own, 0, store, store + size, store + 2 * size, contacts};
    po_point there = {n, own, own, 0, store + 3 * size, store + 4 * size, store + 5 * size, contacts + MOST_NEAR};
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
        s.low[m + j] = fmax(lower[j], -INFINITE_BOUND); s.high[m + j] = fmin(upper[j], INFINITE_BOUND);
        y[m + j] = kept_bounds[j];
      }
      slope.arg[0] = base; slope.arg[1] = given; slope.res[0] = s.slope; slope.res[1] = s.A;
      slopes(slope.arg, slope.res, slope.iw, slope.w, 0);
      if (k) po_place(&scene, base);
      for (i = 0; i < k; ++i) po_contact_slope(&scene, here.contacts + i, s.A + (own + i) * n);
      po_working_set(&s, here.value, y);
      po_orthonormal(&s);
      po_multipliers(&s, s.slope, next);
      for (i = 0; i < m; ++i) weights[i] = fmin(fmax(next[i], -MAX_MULTIPLIER), MAX_MULTIPLIER);
      curvature.arg[0] = base; curvature.arg[1] = given; curvature.arg[2] = weights; curvature.res[0] = s.H;
      hessian(curvature.arg, curvature.res, curvature.iw, curvature.w, 0);
      po_contact_curvature(&scene, base, here.contacts, weights + own, k, s.A + own * n, spare, s.H);
      po_normal(&s); po_free(&s); po_curvature(&s);
      indefinite = po_step(&s, INFINITY, p);
      out[3] = indefinite ? INFINITE_BOUND : 0;
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
        least = least + MERIT_TOLERANCE * fmax(1, fabs(least)) + fmin(VIOLATION_PRICE * out[1], MOST_VIOLATION);
        if (distance <= least) { longest = -1; break; }
        for (longest = 0, j = 0; j < n; ++j) longest = fmax(longest, fabs(p[j]));
        radius = SMALLER * fmin(radius, longest);
        if (!(radius >= SMALLEST_RADIUS)) break;
      }
      for (i = 0; i < k; ++i) full[here.contacts[i].id] = 0;
      if (longest >= 0) break;
      radius = fmin(LONGEST_STEP, LARGER * radius);
      for (furthest = 0, j = 0; j < n; ++j) furthest = fmax(furthest, fabs(x[j] - base[j]));
      for (i = 0; i < ids; ++i) kept_contacts[i] = 0;
      for (i = 0; i < own; ++i) kept[i] = next[i];
      for (i = 0; i < k; ++i) kept_contacts[here.contacts[i].id] = next[own + i];
      for (j = 0; j < n; ++j) { base[j] = x[j]; kept_bounds[j] = next[m + j]; }
      { const po_point left = here; here = there; there = left; }
      still = furthest > LEAST_CHANGE ? 0 : still + 1;
      if (still == MAX_IDLE_STEPS) break;
    }
    out[4] = (double)step; kept_contacts[ids] = radius;
  }
  free(space); free(modelled); free(contacts); po_close(&value); po_close(&slope); po_close(&curvature); po_close(&ik);
  po_scene_close(&scene);
  return failed;
}
