/* SPDX-License-Identifier: BSD-3-Clause
 *
 * First run in C: means of 10 000 Kubo oscillators, and one path.
 *
 *    cc first.c $(pkg-config --cflags --libs symsde) -lm -o first && ./first
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { STEPS = 500, EVERY = 50, TIMES = STEPS / EVERY + 1, PATHS = 100, VALUES = 3 }; /* q, p, H */

static void check(int status, const symsde_error *error) {
   if (status == SYMSDE_OK)
      return;
   fprintf(stderr, "status %d: %s\n", status, error->message);
   exit(1);
}

int main(void) {
   static double t[TIMES], mean[TIMES][VALUES], variance[TIMES][VALUES], se_mean[TIMES][VALUES];
   static double q[TIMES][1][PATHS], p[TIMES][1][PATHS];
   static int64_t n_ok[TIMES], failed_step[PATHS];
   static int32_t path_status[PATHS];
   static symsde_moments moments;
   symsde_error error;

   /* dp = -a q dt - sigma q o dW, dq = a p dt + sigma p o dW: a rotation with a random angular velocity */
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   const char *const names[] = {"a", "sigma"};
   const double values[] = {1.0, 0.3};
   check(symsde_model_get("kubo", 2, names, values, &model, &error), &error);
   check(symsde_scheme_get("midpoint", &scheme, &error), &error);

   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.02;
   options.steps = STEPS;
   options.save_every = EVERY;
   options.paths = 10000;
   options.seed = 1;

   const double q0 = 1.0, p0 = 0.0;
   symsde_input input;
   symsde_input_init(&input);
   input.q0 = &q0; /* one state for all paths */
   input.p0 = &p0;
   input.q0_paths = input.p0_paths = 1;

   symsde_moments_init(&moments); /* the results are written into our arrays */
   moments.t = t;
   moments.n_ok = n_ok;
   moments.mean = &mean[0][0];
   moments.variance = &variance[0][0];
   moments.se_mean = &se_mean[0][0];
   symsde_report report;
   symsde_report_init(&report);
   check(symsde_compute_moments(model, scheme, &options, &input, &moments, &report, &error), &error);
   double end = t[TIMES - 1];
   printf("E q = %.8f +- %.8f at t = %.1f, exact %.8f\n", mean[TIMES - 1][0], se_mean[TIMES - 1][0], end,
          exp(-0.045 * end) * cos(end));

   symsde_paths paths;
   symsde_paths_init(&paths);
   paths.t = t;
   paths.q = &q[0][0][0];
   paths.p = &p[0][0][0];
   paths.status = path_status;
   paths.failed_step = failed_step;
   options.paths = PATHS; /* save the first 100 of these paths: q is [time][dof][path] */
   check(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error), &error);
   double moved = 0.0;
   for (int n = 0; n < TIMES; n++)
      for (int i = 0; i < PATHS; i++)
         moved = fmax(moved, fabs(q[n][0][i] * q[n][0][i] + p[n][0][i] * p[n][0][i] - 1.0));
   printf("path 0 ends at q = %.8f, p = %.8f\n", q[TIMES - 1][0][0], p[TIMES - 1][0][0]);
   printf("%s\n", moved < 1e-12 ? "p^2 + q^2 is kept to 1e-12 on every path" : "p^2 + q^2 has moved");

   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return 0;
}
