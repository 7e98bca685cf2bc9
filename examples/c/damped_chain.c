/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Heat along a chain between two baths: the FPU chain of eight masses, whose first one feels kT = 3/2 and whose last one
 * kT = 1/2. The heat that enters, gamma (kT_1 - <p_1^2>), is the heat that leaves.
 *
 *    cc damped_chain.c $(pkg-config --cflags --libs symsde) -lm -o damped_chain && ./damped_chain
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { N = 8, STEPS = 1500, PATHS = 20000, TIMES = 2, VALUES = 2 * N + 1 }; /* q, p, and the energy */

static void check(int status, const symsde_error *error) {
   if (status == SYMSDE_OK)
      return;
   fprintf(stderr, "%d: %s\n", status, error->message);
   exit(1);
}

int main(void) {
   static double t[TIMES], mean[TIMES][VALUES], variance[TIMES][VALUES], se_mean[TIMES][VALUES];
   static int64_t n_ok[TIMES];
   const char *const keys[] = {"n", "sigma"};
   const double values[] = {N, 0.0}, start[N] = {0};
   symsde_error error;
   symsde_model chain = NULL;
   symsde_scheme scheme = NULL;
   check(symsde_model_get("fpu_chain", 2, keys, values, &chain, &error), &error);

   /* Friction and noise at the ends alone: rates [1/time] and 1/kT of each mass. */
   double gamma[N] = {0}, beta[N];
   for (int i = 0; i < N; i++)
      beta[i] = 1.0;
   gamma[0] = gamma[N - 1] = 1.0;
   beta[0] = 1 / 1.5;
   beta[N - 1] = 1 / 0.5;
   check(symsde_model_thermostat(chain, N, gamma, N, beta, &error), &error);
   check(symsde_scheme_get("chin4a", &scheme, &error), &error);

   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.2;
   options.steps = options.save_every = STEPS;
   options.paths = PATHS;
   options.seed = 1;

   symsde_input input;
   symsde_input_init(&input);
   input.q0 = input.p0 = start;
   input.q0_paths = input.p0_paths = 1;

   symsde_moments moments;
   symsde_moments_init(&moments);
   moments.t = t;
   moments.n_ok = n_ok;
   moments.mean = &mean[0][0];
   moments.variance = &variance[0][0];
   moments.se_mean = &se_mean[0][0];

   symsde_report report;
   symsde_report_init(&report);
   check(symsde_compute_moments(chain, scheme, &options, &input, &moments, &report, &error), &error);

   double kinetic[N];
   printf("kinetic temperatures:");
   for (int i = 0; i < N; i++) {
      kinetic[i] = variance[1][N + i] + mean[1][N + i] * mean[1][N + i];
      printf("%6.2f", kinetic[i]);
   }
   const double hot = 1.5 - kinetic[0], cold = kinetic[N - 1] - 0.5;
   printf("\nheat in%7.4f, heat out%7.4f\n", hot, cold);
   printf("damping: %s\n", report.damping);
   symsde_model_delete(&chain);
   symsde_scheme_delete(&scheme);

   /* Five standard errors of the variances of normal momenta; 1 in 2 million such programs would end with 1. */
   const double room = 5 * sqrt(2 * (kinetic[0] * kinetic[0] + kinetic[N - 1] * kinetic[N - 1]) / PATHS);
   return fabs(hot - cold) < room && hot > 0.1 && cold > 0.1 ? 0 : 1;
}
