#include <math.h>
#include <stdlib.h>

typedef struct { const double** arg; double** res; casadi_int* iw; double* w; } po_memory;
typedef int (*po_sizes)(casadi_int*, casadi_int*, casadi_int*, casadi_int*);

static void po_close(po_memory* m) { free((void*)m->arg); free(m->res); free(m->iw); free(m->w); }
static int po_open(po_memory* m, po_sizes work) {
  casadi_int arg, res, iw, w;
  work(&arg, &res, &iw, &w);
  m->arg = malloc((arg + 1) * sizeof *m->arg);
  m->res = malloc((res + 1) * sizeof *m->res);
  m->iw = malloc((iw + 1) * sizeof *m->iw);
  m->w = malloc((w + 1) * sizeof *m->w);
  return m->arg && m->res && m->iw && m->w;
}
