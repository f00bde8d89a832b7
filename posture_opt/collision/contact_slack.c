long long posture_opt_loop(long long rows, long long n, const double* q, double* slack, long long capsules,
    long long pairs, const double* turns, const double* moved, const double* radii, const double* pair,
    const double* solid, double reach) {
  po_scene scene = {n, capsules, pairs, turns, moved, radii, pair, solid, reach};
  const long long failed = po_scene_open(&scene) ? 0 : -1;
  long long row, count;
  po_contact nearest;
  for (row = 0; row < rows && !failed; ++row) {
    po_place(&scene, q + row * n);
    count = po_contacts(&scene, 1, &nearest);
    slack[row] = count ? nearest.distance - nearest.least : reach;
  }
  po_scene_close(&scene);
  return failed;
}
