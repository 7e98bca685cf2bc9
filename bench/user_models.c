/* SPDX-License-Identifier: BSD-3-Clause
 * The linear oscillator H = (p^2 + q^2)/2, H_1 = -sigma q as a user's batch functions in C (bench/user_models.py). */
#include <stddef.h>

#include "symsde.h"

int bench_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                   double *hq, double *hp, void *user);
int bench_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                  double *hqq, double *hqp, double *hpp, void *user);

int bench_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                   double *restrict hq, double *restrict hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; hq != NULL && i < nlane; i++)
      hq[i] = w[i] * q[i] - w[nlane + i];
   for (int i = 0; hp != NULL && i < nlane; i++)
      hp[i] = w[i] * p[i];
   return 0;
}

int bench_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                  double *restrict hqq, double *restrict hqp, double *restrict hpp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)q, (void)p, (void)user;
   for (int i = 0; hqq != NULL && i < nlane; i++)
      hqq[i] = w[i];
   for (int i = 0; hqp != NULL && i < nlane; i++)
      hqp[i] = 0;
   for (int i = 0; hpp != NULL && i < nlane; i++)
      hpp[i] = w[i];
   return 0;
}
