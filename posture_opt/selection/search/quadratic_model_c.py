"""The C text of :mod:`posture_opt.selection.search.quadratic_model`, for one point at a time.

The same operations in the same order, but for the eigenvalues: here by Jacobi's rotations (Golub and Van Loan 2013,
section 8.5), which are short to write and exact for the few directions that the rows leave.
"""

from __future__ import annotations

from posture_opt.selection.search import quadratic_model as model

_TEXT = """
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
    const int below = y[i] < 0 || value[i] < s->low[i] - ENTERED;
    s->equal[i] = s->low[i] == s->high[i];
    s->above[i] = s->equal[i] != 0 || y[i] > 0 || value[i] > s->high[i] + ENTERED;
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
    l[i] = after > DEPENDENT * before && before > 0 ? sqrt(after) : 0;
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
  double *c = s->spare, least = INFINITY, most = TINY, longest = 0, share, shift, floor;
  for (j = 0; j < n; ++j) longest = fmax(longest, fabs(s->normal[j]));
  share = longest > radius ? radius / longest : 1;
  for (i = 0; i < k; ++i) {
    c[i] = 0;
    for (j = 0; j < n; ++j) c[i] += s->Z[i * n + j] * (s->slope[j] + share * s->bent[j]);
    least = fmin(least, s->values[i]); most = fmax(most, fabs(s->values[i]));
  }
  floor = FLAT * most;
  shift = fmax(0, floor - least);
  for (it = 0; it < SHIFTS; ++it) {
    double size = 0, slope = 0;
    for (i = 0; i < k; ++i) { const double d = s->values[i] + shift, z = c[i] / d; size += z * z; slope += z * z / d; }
    size = sqrt(size);
    if (!(size > radius * (1 + CLOSE))) break;
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
  for (i = 0; i < m + n; ++i) if (y[i] == 0 && fabs(before[i]) == JOINED) y[i] = before[i] > 0 ? STAYING : -STAYING;
  for (i = 0; i < m + n; ++i) {
    change[i] = i < m ? po_dot(n, s->A + i * n, p) : p[i - m];
    if (s->work[i] == 0 && fabs(change[i]) > LEAST)
      first = fmin(first, fmax(((change[i] > 0 ? s->high[i] : s->low[i]) - value[i]) / change[i], 0));
  }
  for (i = 0; i < m + n; ++i) if (s->work[i] == 0 && fabs(change[i]) > LEAST) {
    const double ratio = fmax(((change[i] > 0 ? s->high[i] : s->low[i]) - value[i]) / change[i], 0);
    if (ratio <= first) y[i] = change[i] > 0 ? JOINED : -JOINED;
  }
  for (j = 0; j < n; ++j) p[j] *= first;
}
"""

C_TEXT = (
    _TEXT.replace("ENTERED", repr(model.WORKING_SET_TOLERANCE))
    .replace("DEPENDENT", repr(model.DEPENDENT_ROW_TOLERANCE))
    .replace("PENALTY", repr(model.PENALTY))
    .replace("JOINED", repr(model.JOINED_MULTIPLIER))
    .replace("STAYING", repr(model.STAYING_MULTIPLIER))
    .replace("LEAST", repr(model.LEAST_CHANGE))
    .replace("TINY", repr(model.TINY_CURVATURE))
    .replace("FLAT", repr(model.FLAT_CURVATURE))
    .replace("SHIFTS", repr(model.MAX_SHIFTS))
    .replace("CLOSE", repr(model.RADIUS_TOLERANCE))
)
"""C text of ``po_model`` and its functions, after `posture_opt.model.row_loop`."""
