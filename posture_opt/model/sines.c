/* Sines and cosines of many angles without branches: Cody and Waite's reduction by pi/2 in three parts, then the
 * polynomials of fdlibm (Sun Microsystems, 1993, k_sin.c and k_cos.c). Right to 2e-16 for angles below a million; for
 * larger ones the mathematics library is asked. */
PO_CLONES static void po_sines(const double* restrict x, double* restrict s, double* restrict c, int count) {
  const double whole = 6755399441055744.0; /* 1.5 2^52: adding and subtracting it rounds to whole numbers */
  double largest = 0.0;
  int i;
  for (i = 0; i < count; ++i) largest = fabs(x[i]) > largest ? fabs(x[i]) : largest;
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || (defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0)
  largest = HUGE_VAL; /* sums are not rounded as written: below, that is relied on */
#endif
  if (!(largest < 1e6)) {
    for (i = 0; i < count; ++i) { s[i] = sin(x[i]); c[i] = cos(x[i]); }
    return;
  }
  for (i = 0; i < count; ++i) {
    const double k = (x[i] * 0.63661977236758138 + whole) - whole;
    const double r = ((x[i] - k * 1.57079632673412561417) - k * 6.07710050630396597660e-11)
      - k * 2.02226624879595063154e-21;
    const double z = r * r;
    const double sine = r + r * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03
      + z * (-1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08
      + z * 1.58969099521155010221e-10)))));
    const double cosine = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03
      + z * (2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09
      + z * -1.13596475577881948265e-11))))));
    const double quarter = k - 4.0 * ((k * 0.25 - 0.375 + whole) - whole); /* 0, 1, 2 or 3 */
    const double half = (quarter * 0.5 - 0.25 + whole) - whole; /* 1 from half a turn on */
    const double odd = quarter - 2.0 * half;
    s[i] = (1.0 - 2.0 * half) * (odd * cosine + (1.0 - odd) * sine);
    c[i] = (1.0 - 2.0 * half) * (1.0 - 2.0 * odd) * (odd * sine + (1.0 - odd) * cosine);
  }
}
