/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Observables that are asked for several saved times at once: the moments of one time each, bit for bit. Those that mix
 * lanes are refused.
 */
#include "run.h"

#include <math.h>

enum { NVALUE = 2 + 1 + 2, PROBE = 3 /* calls */ };

static double t[2][NTIME], mean[2][NTIME * NVALUE], variance[2][NTIME * NVALUE], se[2][NTIME * NVALUE];
static int64_t n_ok[2][NTIME];
static int calls, most, mixes, leaves;

/* r^2 (of the neighbouring lane if `mixes` is set), and the time that the function gets */
static int observe(int nlane, int ndof, double time, const double *q, const double *p, double *values, void *user) {
   (void)ndof, (void)user;
   if (leaves && calls == PROBE) {
      return 0; /* return before anything is written */
   }
   for (int i = 0; i < nlane; i++) {
      const int k = mixes ? nlane - 1 - i : i;
      values[i] = q[k] * q[k] + 2 * p[k] * p[k];
      values[nlane + i] = time;
   }
   calls++;
   most = nlane > most ? nlane : most;
   return 0;
}

static int moments_into(int which, int lanes) {
   static symsde_moments m;
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);

   calls = most = 0;
   options.threads = 1;
   symsde_moments_init(&m);
   CHECK(m.observables_lanes == 0);
   m.t = t[which];
   m.n_ok = n_ok[which];
   m.mean = mean[which];
   m.variance = variance[which];
   m.se_mean = se[which];
   m.nobservable = 2;
   m.observables = observe;
   m.observables_lanes = lanes;
   const int status = symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return status;
}

int main(void) {
   OK(moments_into(0, 0));
   CHECK(calls == PROBE + 2 * NTIME && most == 256); /* two blocks of 256 lanes */
   OK(moments_into(1, 1000));
   CHECK(calls == PROBE + 2 * ((NTIME + 2) / 3) && most == 3 * 256);
   for (int i = 0; i < NTIME; i++) {
      CHECK(memcmp(mean[0] + i * NVALUE, mean[1] + i * NVALUE, 4 * sizeof(double)) == 0);
      CHECK(memcmp(variance[0] + i * NVALUE, variance[1] + i * NVALUE, 4 * sizeof(double)) == 0);
      CHECK(mean[0][i * NVALUE + 4] == t[0][i] && mean[1][i * NVALUE + 4] == t[0][i - i % 3]);
   }
   CHECK(mean[0][NVALUE + 3] > 1 && n_ok[1][NTIME - 1] == PATHS);
   OK(moments_into(1, 1)); /* less than a block: a call for each time */
   CHECK(calls == PROBE + 2 * NTIME);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "observables_lanes = -1", moments_into(1, -1));
   leaves = 1;
   OK(moments_into(1, 0));
   CHECK(isnan(mean[1][NVALUE - 1]) && isnan(mean[1][NTIME * NVALUE - 1]));
   /* moments of q are complete nevertheless */
   CHECK(mean[1][NTIME * NVALUE - NVALUE] == mean[0][NTIME * NVALUE - NVALUE]);
   leaves = 0;
   mixes = 1;
   EXPECT(SYMSDE_FALSE_TRAIT, "observable 1 mixes paths", moments_into(1, 0));
   CHECK(calls <= PROBE);
   return close_report();
}
