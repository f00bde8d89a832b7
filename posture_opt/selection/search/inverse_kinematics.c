long long posture_opt_loop(long long rows, long long n, double* q, const double* request, long long request_step,
    long long steps, long long enough, double tolerance, double* error) {
  po_memory ik = {0};
  long long arrived = 0, row, i, step, window = steps / WINDOW;
  double *space = malloc((2 * n + steps + 1) * sizeof *space), *now = space, *next = space + n, *past = next + n;
  if (!space || !po_open(&ik, ik_step_work)) arrived = -1;
  for (row = 0; row < rows && arrived >= 0 && arrived < enough; ++row) {
    double *best = q + row * n, least = INFINITY, distance;
    for (i = 0; i < n; ++i) now[i] = best[i];
    for (step = 0; step < steps; ++step) {
      double* swap;
      ik.arg[0] = now; ik.arg[1] = request + row * request_step; ik.res[0] = next; ik.res[1] = &distance;
      ik_step(ik.arg, ik.res, ik.iw, ik.w, 0);
      if (distance < least) { least = distance; for (i = 0; i < n; ++i) best[i] = now[i]; }
      if (distance < tolerance) { ++arrived; break; }
      past[step] = distance;
      if (step >= window && !(distance < RATIO * past[step - window])) break;
      swap = now; now = next; next = swap;
    }
    error[row] = least;
  }
  free(space); po_close(&ik);
  return arrived;
}
