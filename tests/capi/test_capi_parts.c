/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Models of exact flows of two parts of H (symsde_model_new_parts, symsde_model_set_parts): D = p^2/2, K_0 = q^4/4,
 * K_1 = .5 sin q, with a fault of the noise that the user pointer holds.
 */
#include "run.h"

static arrays a, b;

typedef struct pair_user {
   double fault; /* factor of the noise in kicks */
   int code;     /* return code of drift */
   int drifts, kicks, gradients;
} pair_user;

static int drift(int nlane, int ndof, double t, double tau, const double *q, const double *p, double *qn, double *pn,
                 void *user) {
   pair_user *u = user;
   (void)t;
   CHECK(ndof == 1);
   u->drifts++;
   for (int i = 0; i < nlane; i++) {
      qn[i] = q[i] + tau * p[i];
      pn[i] = p[i];
   }
   return u->code;
}

static int kick(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *qn,
                double *pn, void *user) {
   pair_user *u = user;
   (void)t;
   CHECK(ndof == 1 && nham == 2);
   u->kicks++;
   for (int i = 0; i < nlane; i++) {
      qn[i] = q[i];
      pn[i] = p[i] - w[i] * q[i] * q[i] * q[i] - 0.5 * u->fault * w[nlane + i] * cos(q[i]);
   }
   return 0;
}

static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   pair_user *u = user;
   (void)t;
   CHECK(ndof == 1 && nham == 2);
   u->gradients++;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * q[i] * q[i] * q[i] + 0.5 * w[nlane + i] * cos(q[i]);
      hp[i] = w[i] * p[i];
   }
   return 0;
}

static int value(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                 double *values, void *user) {
   (void)t, (void)user;
   CHECK(ndof == 1 && nham == 2);
   for (int i = 0; i < nlane; i++) {
      values[i] = w[i] * (p[i] * p[i] / 2 + q[i] * q[i] * q[i] * q[i] / 4) + 0.5 * w[nlane + i] * sin(q[i]);
   }
   return 0;
}

static symsde_traits sizes(void) {
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = 1;
   return traits;
}

static void run(symsde_model model, const char *name, arrays *to) {
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(to, 0);
   symsde_scheme scheme = new_scheme(name);
   symsde_report report;

   symsde_report_init(&report);
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   symsde_scheme_delete(&scheme);
}

static int refused(symsde_model model, const char *name) {
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&b, 0);
   symsde_scheme scheme = new_scheme(name);
   symsde_report report;
   int status;

   symsde_report_init(&report);
   status = symsde_simulate(model, scheme, &options, &input, &paths, &report, &error);
   symsde_scheme_delete(&scheme);
   return status;
}

/* largest difference of the saved paths of two runs */
static double difference(void) {
   double largest = 0;
   for (int i = 0; i < NTIME * (int)some_options().paths; i++) {
      largest = fmax(largest, fmax(fabs(a.q[i] - b.q[i]), fabs(a.p[i] - b.p[i])));
   }
   return largest;
}

static void test_flows_alone(void) {
   pair_user user = {.fault = 1};
   symsde_traits traits = sizes();
   symsde_model model, plain;
   double w[2] = {1, 0}, point = 0.5, number;

   OK(symsde_model_new_parts("pair", &traits, drift, kick, value, &user, &model, &error));
   OK(symsde_model_traits(model, &traits, &error));
   CHECK(traits.has_parts == 1 && traits.has_gradient == 0 && traits.has_value == 1);
   OK(symsde_model_probe(model, 0, &point, &point, &error));
   run(model, "gauss_dkdkd", &a);
   CHECK(user.drifts > 0 && user.kicks > 0 && user.gradients == 0);
   traits = sizes();
   traits.identity_mass = traits.position_noise = 1;
   OK(symsde_model_new("plain", &traits, gradient, value, NULL, NULL, &user, &plain, &error));
   OK(symsde_model_traits(plain, &traits, &error));
   CHECK(traits.has_parts == 0 && traits.has_gradient == 1);
   run(plain, "gauss_dkdkd", &b);
   CHECK(difference() < 1e-13);
   run(model, "verlet_dkd_weak2", &a);
   run(plain, "verlet_dkd_weak2", &b);
   CHECK(difference() < 1e-13);
   OK(symsde_model_value(model, 1, 0, w, &point, &point, &number, &error));
   CHECK(fabs(number - 0.140625) < 1e-16);
   EXPECT(SYMSDE_MISSING_OPERATION, "pair|no gradient",
          symsde_model_gradient(model, 1, 0, w, &point, &point, &number, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "chin4a|D_pp|gauss_dkdkd", refused(model, "chin4a"));
   EXPECT(SYMSDE_INCOMPATIBLE, "midpoint|gradients of the Hamiltonians", refused(model, "midpoint"));
   user.code = 7;
   EXPECT(SYMSDE_CALLBACK_FAILED, "7", refused(model, "gauss_dkdkd"));
   user.code = 0;
   OK(symsde_model_set_derived(model, &error)); /* outputs are then known to be written */
   run(model, "gauss_dkdkd", &a);
   run(plain, "gauss_dkdkd", &b);
   CHECK(difference() < 1e-13);
   symsde_model_delete(&model);
   symsde_model_delete(&plain);
}

static void test_flows_beside_a_gradient(void) {
   pair_user user = {.fault = 1};
   symsde_traits traits = sizes();
   symsde_model model, kubo = new_kubo();

   OK(symsde_model_new("both", &traits, gradient, NULL, NULL, NULL, &user, &model, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "gauss_dkdkd", refused(model, "gauss_dkdkd"));
   OK(symsde_model_set_parts(model, drift, kick, &error));
   run(model, "gauss_dkdkd", &a);
   CHECK(user.drifts > 0);
   user.fault = 1.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "both|kick by noises|gradient of H_1", refused(model, "gauss_dkdkd"));
   user.fault = 1;
   OK(symsde_model_set_parts(model, NULL, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "gauss_dkdkd", refused(model, "gauss_dkdkd"));
   EXPECT(SYMSDE_MISSING_OPERATION, "both|drift and kick", symsde_model_set_parts(model, drift, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_set_parts(kubo, drift, kick, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
}

static void test_refusals(void) {
   pair_user user = {.fault = 1};
   symsde_traits traits = sizes();
   symsde_model model;

   EXPECT(SYMSDE_MISSING_OPERATION, "lacks the function drift or kick",
          symsde_model_new_parts("x", &traits, drift, NULL, NULL, &user, &model, &error));
   traits.additive = 1;
   EXPECT(SYMSDE_INCOMPATIBLE, "declares additive",
          symsde_model_new_parts("x", &traits, drift, kick, NULL, &user, &model, &error));
   traits.additive = 0;
   traits.ndof = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "degrees of freedom",
          symsde_model_new_parts("x", &traits, drift, kick, NULL, &user, &model, &error));
   traits.ndof = 1;
   OK(symsde_model_new_parts("x", &traits, drift, kick, NULL, &user, &model, &error));
   EXPECT(SYMSDE_MISSING_OPERATION, "drift and kick", symsde_model_set_parts(model, NULL, NULL, &error));
   const double second[4] = {0, 0, 0, 1};
   EXPECT(SYMSDE_MISSING_OPERATION, "no gradient", symsde_model_set_quadratic_part(model, second, &error));
   symsde_model_delete(&model);
}

int main(void) {
   test_flows_alone();
   test_flows_beside_a_gradient();
   test_refusals();
   return close_report();
}
