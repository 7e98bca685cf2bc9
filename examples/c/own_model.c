/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Your own model in C: a pendulum that is shaken sideways.
 *
 *    H = p^2/2 - cos q,   H_1 = sigma sin q      (noise that depends on position alone)
 *
 *    cc own_model.c $(pkg-config --cflags --libs symsde) -lm -o own_model && ./own_model
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { STEPS = 200, TIMES = 2, VALUES = 2 }; /* times 0 and 10; q and p */

/* Gradient of w[0] H + w[1] H_1 for a block of paths: arrays are [..][nlane], one lane for each path;
   w has nham rows, one for H and one for each noise. */
static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   const double sigma = *(const double *)user;
   const double *h = w, *dw = w + nlane;
   double sine[nlane], cosine[nlane];
   (void)ndof, (void)nham, (void)t;
   symsde_sincos(nlane, q, sine, cosine);
   for (int i = 0; i < nlane; i++) {
      hq[i] = h[i] * sine[i] + dw[i] * sigma * cosine[i];
      hp[i] = h[i] * p[i];
   }
   return 0; /* nonzero would abort the run */
}

/* Second derivatives. They are optional: without them they are approximated by differences of gradients. */
static int hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                   double *hqq, double *hqp, double *hpp, void *user) {
   const double sigma = *(const double *)user;
   const double *h = w, *dw = w + nlane;
   double sine[nlane], cosine[nlane];
   (void)ndof, (void)nham, (void)t, (void)p;
   symsde_sincos(nlane, q, sine, cosine);
   for (int i = 0; i < nlane; i++) {
      hqq[i] = h[i] * cosine[i] - dw[i] * sigma * sine[i];
      hqp[i] = 0.0;
      hpp[i] = h[i];
   }
   return 0;
}

static void check(int status, const symsde_error *error) {
   char text[200];
   if (status == SYMSDE_OK)
      return;
   symsde_status_text(status, text, sizeof text, NULL); /* what the status is called; the sentence says more */
   fprintf(stderr, "%s (%d): %s\n", text, status, error->message);
   exit(1);
}

int main(void) {
   double t[TIMES], mean[TIMES][VALUES], variance[TIMES][VALUES], se_mean[TIMES][VALUES];
   double sigma = 0.3;
   const double q0 = 1.0, p0 = 0.0;
   int64_t n_ok[TIMES];
   symsde_error error;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;

   /* Declared traits decide which work is skipped. A false trait is refused by name. */
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = 1;
   traits.nnoise = 1;
   traits.separable = traits.position_noise = traits.identity_mass = 1;
   check(symsde_model_new("pendulum", &traits, gradient, NULL, hessian, NULL, &sigma, &model, &error), &error);
   check(symsde_scheme_get("midpoint", &scheme, &error), &error);

   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.05;
   options.steps = options.save_every = STEPS;
   options.paths = 20000;
   options.seed = 3;

   symsde_input input;
   symsde_input_init(&input);
   input.q0 = &q0; /* one state for all paths */
   input.p0 = &p0;
   input.q0_paths = input.p0_paths = 1;

   symsde_moments moments; /* the results are written into our arrays */
   symsde_moments_init(&moments);
   moments.t = t;
   moments.n_ok = n_ok;
   moments.mean = &mean[0][0];
   moments.variance = &variance[0][0];
   moments.se_mean = &se_mean[0][0];

   symsde_report report;
   symsde_report_init(&report);
   check(symsde_compute_moments(model, scheme, &options, &input, &moments, &report, &error), &error);
   printf("E q = %.6f +- %.6f at t = %.1f\n", mean[1][0], se_mean[1][0], t[1]);
   printf("stepper: %s; left out: %s\n", report.stepper, report.left_out);

   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return isfinite(mean[1][0]) ? 0 : 1;
}
