/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Your own model in C: the Duffing oscillator with noise in its stiffness.
 *
 *    H = p^2/2 + q^2/2 + q^4/4,   H_1 = sigma q^2/2      (noise that depends on position alone)
 *
 *    cc own_model.c $(pkg-config --cflags --libs symsde) -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { PATHS = 1000, STEPS = 500 };

/* Gradient of w[0] H + w[1] H_1 for a block of paths: arrays are [..][nlane], one lane for each path. */
static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   const double sigma = *(const double *)user;
   const double *h = w, *dw = w + nlane;
   (void)ndof, (void)nham, (void)t;
   for (int i = 0; i < nlane; i++)
      hq[i] = h[i] * (q[i] + q[i] * q[i] * q[i]) + dw[i] * sigma * q[i];
   for (int i = 0; i < nlane; i++)
      hp[i] = h[i] * p[i];
   return 0; /* nonzero would abort the run */
}

static void check(int status, const symsde_error *error) {
   if (status == SYMSDE_OK)
      return;
   fprintf(stderr, "status %d: %s\n", status, error->message);
   exit(1);
}

int main(void) {
   static double t[STEPS / 100 + 1], q[STEPS / 100 + 1][1][PATHS], p[STEPS / 100 + 1][1][PATHS];
   static int32_t path_status[PATHS];
   static int64_t failed_step[PATHS];
   double sigma = 0.2, q0 = 1.0, p0 = 0.0, mean = 0.0;
   symsde_error error;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;

   /* Declared traits decide which work is skipped. A false trait is refused by name. */
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = 1;
   traits.nnoise = 1;
   traits.separable = traits.position_noise = traits.identity_mass = 1;
   check(symsde_model_new("duffing", &traits, gradient, NULL, NULL, NULL, &sigma, &model, &error), &error);
   check(symsde_scheme_get("stormer_verlet", &scheme, &error), &error);

   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.02;
   options.steps = STEPS;
   options.paths = PATHS;
   options.seed = 42;
   options.save_every = 100;

   symsde_input input;
   symsde_input_init(&input);
   input.q0 = &q0; /* one state for all paths */
   input.p0 = &p0;
   input.q0_paths = input.p0_paths = 1;

   symsde_paths paths; /* the results are written into our arrays */
   symsde_paths_init(&paths);
   paths.t = t;
   paths.q = &q[0][0][0];
   paths.p = &p[0][0][0];
   paths.status = path_status;
   paths.failed_step = failed_step;

   symsde_report report;
   symsde_report_init(&report);
   check(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error), &error);

   for (int i = 0; i < PATHS; i++)
      mean += q[STEPS / 100][0][i] / PATHS;
   printf("stepper: %s; left out: %s\n", report.stepper, report.left_out);
   printf("mean of q at t = %.1f over %d paths: %.4f\n", t[STEPS / 100], PATHS, mean);

   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return isfinite(mean) ? 0 : 1;
}
