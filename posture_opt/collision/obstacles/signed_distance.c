/* A box is three intervals, a cylinder a disc and an interval.
 * With e_g = |p_g| - h_g of each ball the signed distance is sqrt(sum max(e_g, 0)^2) outside
 * and max e_g inside, a convex function of the point. */
static double po_signed_distance(const double* solid, const double* x, double* normal) {
  const double *R = solid, *origin = solid + 9, *group = solid + 12, *size = solid + 15;
  const int one_sided = solid[18] != 0;
  double p[3], length[3] = {0, 0, 0}, way[3] = {0, 0, 0}, excess, deepest = -INFINITY, outside = 0;
  int i, k, g, best = 0, first;
  for (k = 0; k < 3; ++k) {
    p[k] = 0;
    for (i = 0; i < 3; ++i) p[k] += R[3 * i + k] * (x[i] - origin[i]);
    if (group[k] >= 0) length[(int)group[k]] += p[k] * p[k];
  }
  for (g = 0; g < 3; ++g) {
    for (first = 0; first < 3 && (int)group[first] != g; ++first) {}
    if (first == 3) continue;
    length[g] = one_sided ? p[first] : sqrt(length[g]);
    excess = length[g] - size[g];
    if (excess > deepest) { deepest = excess; best = g; }
    outside += excess > 0 ? excess * excess : 0;
  }
  outside = sqrt(outside);
  for (k = 0; k < 3; ++k) {
    double share;
    g = (int)group[k];
    if (g < 0) continue;
    for (first = 0; (int)group[first] != g; ++first) {}
    excess = length[g] - size[g];
    share = outside > LEAST ? (excess > 0 ? excess / outside : 0) : g == best;
    if (one_sided) way[k] = share;
    else way[k] = share * (length[g] > LEAST ? p[k] / length[g] : k == first);
  }
  for (i = 0; i < 3; ++i) for (normal[i] = 0, k = 0; k < 3; ++k) normal[i] += R[3 * i + k] * way[k];
  return outside > LEAST ? outside : deepest;
}
