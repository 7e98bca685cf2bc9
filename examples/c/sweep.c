/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A sweep over the strength of the noise: one run, whose paths have five values of it.
 *
 *    H = p^2/2 - omega^2 cos q,   H_1 = sigma sin q,   H_2 = -sigma cos q,   so that E H = H_0 + sigma^2 t/2
 *
 *    cc sweep.c $(pkg-config --cflags --libs symsde) -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { VALUES = 5, EACH = 2000, PATHS = VALUES * EACH, STEPS = 200 };

static void check(int status, const symsde_error *error) {
   if (status == SYMSDE_OK)
      return;
   fprintf(stderr, "status %d: %s\n", status, error->message);
   exit(1);
}

int main(void) {
   const char *keys[] = {"omega", "sigma1", "sigma2"};
   const double q0 = 1.0, p0 = 0.0;
   static double values[3][VALUES], t[2], q[2][PATHS], p[2][PATHS]; /* a row of parameters for each value */
   static int32_t status[PATHS];
   static int64_t failed_step[PATHS];
   symsde_error error;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;

   for (int i = 0; i < VALUES; i++) {
      values[0][i] = 2.0;
      values[1][i] = values[2][i] = 0.1 * (i + 1);
   }
   check(symsde_model_get_by_path("synchrotron", 3, keys, VALUES, values[0], &model, &error), &error);
   check(symsde_scheme_get("stormer_verlet", &scheme, &error), &error);
   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.05;
   options.steps = options.save_every = STEPS;
   options.paths = PATHS;
   options.row_paths = EACH; /* path i has row i/EACH; without it there is a row for each path */
   options.seed = 1;
   symsde_input input;
   symsde_input_init(&input);
   input.q0 = &q0;
   input.p0 = &p0;
   symsde_paths paths;
   symsde_paths_init(&paths);
   paths.t = t;
   paths.q = q[0];
   paths.p = p[0];
   paths.status = status;
   paths.failed_step = failed_step;
   check(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error), &error);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);

   double worst = 0.0;
   for (int i = 0; i < VALUES; i++) {
      const double sigma = values[1][i], exact = -4 * cos(q0) + sigma * sigma * t[1] / 2;
      double sum = 0.0, squares = 0.0;
      for (int j = i * EACH; j < (i + 1) * EACH; j++) {
         const double energy = p[1][j] * p[1][j] / 2 - 4 * cos(q[1][j]);
         sum += energy;
         squares += energy * energy;
      }
      const double mean = sum / EACH, se = sqrt((squares / EACH - mean * mean) / EACH);
      printf("sigma = %.1f: E H = %6.3f +- %.3f at t = %g, exactly %6.3f\n", sigma, mean, se, t[1], exact);
      worst = fmax(worst, fabs(mean - exact) / se);
   }
   return worst < 5 ? 0 : 1;
}
