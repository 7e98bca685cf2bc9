/* SPDX-License-Identifier: BSD-3-Clause
 * The synchrotron as a user's batch functions in C:
 *
 *    H = p^2/2 - omega^2 cos q,   H_1 = sigma1 sin q,   H_2 = -sigma2 cos q */
#include <stddef.h>

#include "symsde.h"

static const double omega = 2.0, sigma1 = 0.2, sigma2 = 0.1;

int user_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                  double *hq, double *hp, void *user);
int user_gradient_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, double *hqq, double *hqp, double *hpp, void *user);

int user_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                  double *hq, double *hp, void *user) {
   return user_gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, NULL, NULL, NULL, user);
}

int user_gradient_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
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
