/* SPDX-License-Identifier: BSD-3-Clause
 * Two models of the catalogue as a user's batch functions in C (bench/models.f90):
 *
 *    linear oscillator   H = (p^2 + q^2)/2,             H_1 = -q
 *    synchrotron         H = p^2/2 - omega^2 cos q,     H_1 = sigma1 sin q,  H_2 = -sigma2 cos q
 *
 * The synchrotron twice: by symsde_sincos, with gradient and Hessian together, and by the C library. Of that, sine
 * and cosine of one argument in one loop become a scalar call of sincos for each lane; in loops of their own
 * gcc -O3 takes the vector versions of the C library, if it is told of them: by -ffast-math (but not when linking,
 * where it changes the arithmetic of the whole process), or by the two declarations below. */
#include <math.h>
#include <stddef.h>

#include "symsde.h"

double sin(double) __attribute__((simd("notinbranch")));
double cos(double) __attribute__((simd("notinbranch")));

static const double omega = 2.0, sigma1 = 0.2, sigma2 = 0.1;

int bench_oscillator_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                              const double *p, double *hq, double *hp, void *user);
int bench_oscillator_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                             double *hqq, double *hqp, double *hpp, void *user);
int bench_synchrotron_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                               const double *p, double *hq, double *hp, void *user);
int bench_synchrotron_both(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                           double *hq, double *hp, double *hqq, double *hqp, double *hpp, void *user);
int bench_plain_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                         double *hq, double *hp, void *user);
int bench_plain_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                        double *hqq, double *hqp, double *hpp, void *user);

int bench_oscillator_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                              const double *p, double *restrict hq, double *restrict hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; hq != NULL && i < nlane; i++)
      hq[i] = w[i] * q[i] - w[nlane + i];
   for (int i = 0; hp != NULL && i < nlane; i++)
      hp[i] = w[i] * p[i];
   return 0;
}

int bench_oscillator_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
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

int bench_synchrotron_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                               const double *p, double *hq, double *hp, void *user) {
   return bench_synchrotron_both(nlane, ndof, nham, t, w, q, p, hq, hp, NULL, NULL, NULL, user);
}

int bench_synchrotron_both(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                           double *restrict hq, double *restrict hp, double *restrict hqq, double *restrict hqp,
                           double *restrict hpp, void *user) {
   const double *dw1 = w + nlane, *dw2 = w + 2 * nlane;
   double sine[nlane], cosine[nlane];
   (void)ndof, (void)nham, (void)t, (void)user;
   if ((hq != NULL || hqq != NULL) && symsde_sincos(nlane, q, sine, cosine) != SYMSDE_OK)
      return 1;
   for (int i = 0; hq != NULL && i < nlane; i++)
      hq[i] = (omega * omega * w[i] + sigma2 * dw2[i]) * sine[i] + sigma1 * dw1[i] * cosine[i];
   for (int i = 0; hqq != NULL && i < nlane; i++)
      hqq[i] = (omega * omega * w[i] + sigma2 * dw2[i]) * cosine[i] - sigma1 * dw1[i] * sine[i];
   for (int i = 0; hp != NULL && i < nlane; i++)
      hp[i] = w[i] * p[i];
   for (int i = 0; hqp != NULL && i < nlane; i++)
      hqp[i] = 0;
   for (int i = 0; hpp != NULL && i < nlane; i++)
      hpp[i] = w[i];
   return 0;
}

int bench_plain_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                         double *restrict hq, double *restrict hp, void *user) {
   const double *dw1 = w + nlane, *dw2 = w + 2 * nlane;
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; hq != NULL && i < nlane; i++)
      hq[i] = (omega * omega * w[i] + sigma2 * dw2[i]) * sin(q[i]);
   for (int i = 0; hq != NULL && i < nlane; i++)
      hq[i] += sigma1 * dw1[i] * cos(q[i]);
   for (int i = 0; hp != NULL && i < nlane; i++)
      hp[i] = w[i] * p[i];
   return 0;
}

int bench_plain_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                        double *restrict hqq, double *restrict hqp, double *restrict hpp, void *user) {
   const double *dw1 = w + nlane, *dw2 = w + 2 * nlane;
   (void)ndof, (void)nham, (void)t, (void)p, (void)user;
   for (int i = 0; hqq != NULL && i < nlane; i++)
      hqq[i] = (omega * omega * w[i] + sigma2 * dw2[i]) * cos(q[i]);
   for (int i = 0; hqq != NULL && i < nlane; i++)
      hqq[i] -= sigma1 * dw1[i] * sin(q[i]);
   for (int i = 0; hqp != NULL && i < nlane; i++)
      hqp[i] = 0;
   for (int i = 0; hpp != NULL && i < nlane; i++)
      hpp[i] = w[i];
   return 0;
}
