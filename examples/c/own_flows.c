/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Two exact flows of your own in C, without a gradient: a charge that circles in a magnetic field B, in a quartic trap,
 * pushed by noise.
 *
 *    D = |v|^2/2,  v = p + B (q_2, -q_1)/2,      K_0 = |q|^4/4,      K_k = sigma q_k,  k = 1, 2
 *
 * Velocities turn by the angle B tau in the drift, kicks change p alone, and gauss_dkdkd has strong order 2. Each noise
 * gives the energy D + K_0 the mean sigma^2/2 in a unit of time, both together sigma^2.
 *
 *    cc own_flows.c $(pkg-config --cflags --libs symsde) -lm -o own_flows && ./own_flows
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { STEPS = 200, TIMES = 2, VALUES = 5 }; /* times 0 and 4; q, p and the energy */

static const double B = 2.0, sigma = 0.3;

/* The flow of D over the time tau, of either sign: arrays are [2][nlane], and all of the new state is written. */
static int drift(int nlane, int ndof, double t, double tau, const double *q, const double *p, double *qn, double *pn,
                 void *user) {
   const double s = sin(B * tau), c = cos(B * tau);
   (void)ndof, (void)t, (void)user;
   for (int i = 0, j = nlane; i < nlane; i++, j++) {
      const double v1 = p[i] + B / 2 * q[j], v2 = p[j] - B / 2 * q[i];
      qn[i] = q[i] + (s * v1 + (1 - c) * v2) / B;
      qn[j] = q[j] + (s * v2 - (1 - c) * v1) / B;
      pn[i] = c * v1 + s * v2 - B / 2 * qn[j];
      pn[j] = c * v2 - s * v1 + B / 2 * qn[i];
   }
   return 0; /* nonzero would abort the run */
}

/* The flow of w[0] K_0 + w[1] K_1 + w[2] K_2 over one unit of time; w is [3][nlane], each path has its own weights. */
static int kick(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *qn,
                double *pn, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0, j = nlane; i < nlane; i++, j++) {
      const double r = q[i] * q[i] + q[j] * q[j];
      qn[i] = q[i];
      qn[j] = q[j];
      pn[i] = p[i] - w[i] * r * q[i] - sigma * w[nlane + i];
      pn[j] = p[j] - w[i] * r * q[j] - sigma * w[2 * nlane + i];
   }
   return 0;
}

/* The weighted sum of the Hamiltonians, which is optional: with it runs have energies. */
static int value(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                 double *values, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0, j = nlane; i < nlane; i++, j++) {
      const double v1 = p[i] + B / 2 * q[j], v2 = p[j] - B / 2 * q[i], r = q[i] * q[i] + q[j] * q[j];
      values[i] = w[i] * ((v1 * v1 + v2 * v2) / 2 + r * r / 4);
      values[i] += sigma * (w[nlane + i] * q[i] + w[2 * nlane + i] * q[j]);
   }
   return 0;
}

static void check(int status, const symsde_error *error) {
   if (status == SYMSDE_OK)
      return;
   fprintf(stderr, "%s\n", error->message);
   exit(1);
}

int main(void) {
   double t[TIMES], mean[TIMES][VALUES], variance[TIMES][VALUES], se_mean[TIMES][VALUES];
   const double q0[2] = {0.8, 0.0}, p0[2] = {0.0, 0.5};
   int64_t n_ok[TIMES];
   symsde_error error;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;

   symsde_traits traits; /* of two flows sizes alone: a run tests that they are flows, symplectic, and kicks commute */
   symsde_traits_init(&traits);
   traits.ndof = 2;
   traits.nnoise = 2;
   check(symsde_model_new_parts("charge", &traits, drift, kick, value, NULL, &model, &error), &error);
   check(symsde_scheme_get("gauss_dkdkd", &scheme, &error), &error);

   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.02;
   options.steps = options.save_every = STEPS;
   options.paths = 20000;
   options.seed = 3;

   symsde_input input;
   symsde_input_init(&input);
   input.q0 = q0;
   input.p0 = p0;
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
   check(symsde_compute_moments(model, scheme, &options, &input, &moments, &report, &error), &error);
   const double grown = mean[1][4] - mean[0][4], right = sigma * sigma * t[1];
   printf("the energy grows by %.4f +- %.4f, and by %.4f in theory\n", grown, se_mean[1][4], right);
   printf("stepper: %s\n", report.stepper);

   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return fabs(grown - right) < 5 * se_mean[1][4] ? 0 : 1; /* false alarm 6e-7 */
}
