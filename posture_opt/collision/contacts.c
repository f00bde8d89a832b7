typedef struct {
  long long n, capsules, pairs;
  const double *turns, *moved, *radii, *pair, *solid;
  double reach;
  double *axes, *origins, *starts, *ends;
  po_memory memory;
} po_scene;
typedef struct { long long id; double distance, least, a[3], b[3], normal[3]; } po_contact;

static double po_dot3(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Makes a vector a unit vector, `other` where it has no direction; returns its length. */
static double po_unit(double* v, const double* other) {
  const double size = sqrt(po_dot3(v, v));
  long long i;
  for (i = 0; i < 3; ++i) v[i] = size > TINY ? v[i] / size : other[i];
  return size;
}

/* Where the joints and the capsules are. */
static void po_place(po_scene* s, const double* q) {
  s->memory.arg[0] = q; s->memory.res[0] = s->axes; s->memory.res[1] = s->origins;
  s->memory.res[2] = s->starts; s->memory.res[3] = s->ends;
  frames(s->memory.arg, s->memory.res, s->memory.iw, s->memory.w, 0);
}

static void po_at(const double* start, const double* end, double share, double* x) {
  long long i;
  for (i = 0; i < 3; ++i) x[i] = start[i] + share * (end[i] - start[i]);
}

/* A capsule against a solid: its ends, and where its inside is nearest if that is neither. */
static int po_near_solid(const po_scene* s, const double* row, int which, po_contact* c) {
  const long long a = (long long)row[0];
  const double *start = s->starts + 3 * a, *end = s->ends + 3 * a, *solid = s->solid + SOLID * (long long)row[2];
  double share = which == 1, along[3], normal[3], low = 0, high = 1;
  long long i;
  for (i = 0; i < 3; ++i) along[i] = end[i] - start[i];
  if (which > 2 || (which > 0 && po_dot3(along, along) < TINY * TINY)) return 0;
  if (which == 2) {
    po_signed_distance(solid, start, normal);
    if (!(po_dot3(normal, along) < 0)) return 0;
    po_signed_distance(solid, end, normal);
    if (!(po_dot3(normal, along) > 0)) return 0;
    for (i = 0; i < BISECTIONS; ++i) {
      share = (low + high) / 2;
      po_at(start, end, share, c->a);
      po_signed_distance(solid, c->a, normal);
      if (po_dot3(normal, along) < 0) low = share; else high = share;
    }
  }
  po_at(start, end, share, c->a);
  c->distance = po_signed_distance(solid, c->a, c->normal) - s->radii[a];
  return 1;
}

/* Two capsules: the ends of each against the other one, and where both insides are nearest. */
static int po_near_capsule(const po_scene* s, const double* row, int which, po_contact* c) {
  const long long a = (long long)row[0], b = (long long)row[1];
  const double *start = s->starts + 3 * a, *end = s->ends + 3 * a, *from = s->starts + 3 * b, *to = s->ends + 3 * b;
  double share = which == 1, t = which == 4, u[3], v[3], w[3], up[3] = {0, 0, 1}, uu, uv, vv, uw, vw, size;
  long long i;
  for (i = 0; i < 3; ++i) { u[i] = end[i] - start[i]; v[i] = to[i] - from[i]; w[i] = start[i] - from[i]; }
  uu = po_dot3(u, u); uv = po_dot3(u, v); vv = po_dot3(v, v); uw = po_dot3(u, w); vw = po_dot3(v, w);
  size = uu * vv - uv * uv;
  if (which < 2) t = fmin(fmax((vw + share * uv) / fmax(vv, TINY * TINY), 0), 1);
  else if (which > 2) share = fmin(fmax((t * uv - uw) / fmax(uu, TINY * TINY), 0), 1);
  else {
    if (!(size > PARALLEL * uu * vv)) return 0;
    share = (uv * vw - vv * uw) / size; t = (uu * vw - uv * uw) / size;
    if (!(share > 0 && share < 1 && t > 0 && t < 1)) return 0;
  }
  po_at(start, end, share, c->a); po_at(from, to, t, c->b);
  for (i = 0; i < 3; ++i) c->normal[i] = c->a[i] - c->b[i];
  w[0] = u[1] * v[2] - u[2] * v[1]; w[1] = u[2] * v[0] - u[0] * v[2]; w[2] = u[0] * v[1] - u[1] * v[0];
  po_unit(w, up);
  c->distance = po_unit(c->normal, w) - s->radii[a] - s->radii[b];
  return 1;
}

/* Point `which` of a pair; returns whether there is one. */
static int po_contact_of(const po_scene* s, long long pair, int which, po_contact* c) {
  const double* row = s->pair + 4 * pair;
  c->id = POINTS * pair + which; c->least = row[3];
  return row[1] < 0 ? po_near_solid(s, row, which, c) : po_near_capsule(s, row, which, c);
}

static void po_scene_close(po_scene* s) { free(s->axes); po_close(&s->memory); }
static int po_scene_open(po_scene* s) {
  s->axes = malloc((6 * s->n + 6 * s->capsules + 1) * sizeof *s->axes);
  s->origins = s->axes + 3 * s->n; s->starts = s->origins + 3 * s->n; s->ends = s->starts + 3 * s->capsules;
  return po_open(&s->memory, frames_work) && s->axes;
}

/* Whether two bodies may be nearer than the reach, by the spheres about them. */
static int po_may_be_near(const po_scene* s, const double* row) {
  double away[3], size = 0, bound, distance;
  long long i, side;
  for (i = 0; i < 3; ++i) away[i] = 0;
  for (side = 0; side < 2; ++side) {
    const long long k = (long long)row[side];
    double along[3];
    if (k < 0) {
      const double* solid = s->solid + SOLID * (long long)row[2];
      bound = solid[SOLID - 1];
      for (i = 0; i < 3; ++i) away[i] -= solid[9 + i];
    } else {
      for (i = 0; i < 3; ++i) {
        along[i] = (s->ends[3 * k + i] - s->starts[3 * k + i]) / 2;
        away[i] += (side ? -1 : 1) * (s->starts[3 * k + i] + along[i]);
      }
      bound = sqrt(po_dot3(along, along)) + s->radii[k];
    }
    size += bound;
  }
  distance = sqrt(po_dot3(away, away));
  return distance - size < row[3] + s->reach;
}

/* What is nearer than its least distance and the reach, at most `most` of it, the nearest. */
static long long po_contacts(const po_scene* s, long long most, po_contact* out) {
  long long pair, count = 0, k;
  int which;
  for (pair = 0; pair < s->pairs; ++pair) {
    if (!po_may_be_near(s, s->pair + 4 * pair)) continue;
    for (which = 0; which < POINTS; ++which) {
      po_contact c;
      long long farthest = 0;
      if (!po_contact_of(s, pair, which, &c) || !(c.distance - c.least < s->reach)) continue;
      if (count < most) { out[count++] = c; continue; }
      for (k = 1; k < most; ++k)
        if (out[k].distance - out[k].least > out[farthest].distance - out[farthest].least) farthest = k;
      if (c.distance - c.least < out[farthest].distance - out[farthest].least) out[farthest] = c;
    }
  }
  return count;
}

/* Slope of a distance in the joint values: how fast its points part along the normal. */
static void po_contact_slope(const po_scene* s, const po_contact* c, double* slope) {
  const double* row = s->pair + 4 * (c->id / POINTS);
  long long side, j, i;
  for (j = 0; j < s->n; ++j) slope[j] = 0;
  for (side = 0; side < 2; ++side) {
    const long long k = (long long)row[side];
    const double* x = side ? c->b : c->a;
    if (k < 0) continue;
    for (j = 0; j < s->n && j < s->moved[k]; ++j) {
      const double *z = s->axes + 3 * j, *o = s->origins + 3 * j;
      double v[3], arm[3];
      for (i = 0; i < 3; ++i) { arm[i] = x[i] - o[i]; v[i] = z[i]; }
      if (s->turns[j] != 0) {
        v[0] = z[1] * arm[2] - z[2] * arm[1];
        v[1] = z[2] * arm[0] - z[0] * arm[2];
        v[2] = z[0] * arm[1] - z[1] * arm[0];
      }
      slope[j] += (side ? -1 : 1) * po_dot3(c->normal, v);
    }
  }
}

/* Adds to H the curvature of the contacts that have a weight, by differences of their slopes. */
static void po_contact_curvature(po_scene* s, double* q, const po_contact* c, const double* weights, long long count,
    const double* slopes, double* spare, double* H) {
  long long n = s->n, i, j, k, any = 0;
  for (k = 0; k < count; ++k) any += weights[k] != 0;
  if (!any) return;
  for (i = 0; i < n; ++i) {
    const double kept = q[i];
    q[i] += DIFFERENCE;
    po_place(s, q);
    q[i] = kept;
    for (k = 0; k < count; ++k) {
      po_contact there;
      if (weights[k] == 0 || !po_contact_of(s, c[k].id / POINTS, (int)(c[k].id % POINTS), &there)) continue;
      po_contact_slope(s, &there, spare);
      for (j = 0; j < n; ++j) {
        const double bend = weights[k] * (spare[j] - slopes[k * n + j]) / (2 * DIFFERENCE);
        H[i * n + j] += bend; H[j * n + i] += bend;
      }
    }
  }
}
