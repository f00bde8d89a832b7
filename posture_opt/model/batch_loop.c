#include <stdlib.h>

CASADI_SYMBOL_EXPORT long long posture_opt_batch(long long rows, const double* const* inputs,
    const long long* steps, double* const* outputs, const long long* sizes) {
  casadi_int sz_arg, sz_res, sz_iw, sz_w, i;
  long long row, failed = 0;
  const double** arg; double** res; casadi_int* iw; double* w;
  posture_opt_row_work(&sz_arg, &sz_res, &sz_iw, &sz_w);
  arg = malloc((sz_arg + 1) * sizeof *arg);
  res = malloc((sz_res + 1) * sizeof *res);
  iw = malloc((sz_iw + 1) * sizeof *iw);
  w = malloc((sz_w + 1) * sizeof *w);
  if (!arg || !res || !iw || !w) failed = -1;
  for (row = 0; row < rows && !failed; ++row) {
    for (i = 0; i < posture_opt_row_n_in(); ++i) arg[i] = inputs[i] + row * steps[i];
    for (i = 0; i < posture_opt_row_n_out(); ++i) res[i] = outputs[i] + row * sizes[i];
    if (posture_opt_row(arg, res, iw, w, 0)) failed = row + 1;
  }
  free(arg); free(res); free(iw); free(w);
  return failed;
}
