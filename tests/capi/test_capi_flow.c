/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Whole steps that a user's model defines (symsde_model_set_flow), and functions that take any number of lanes.
 */
#include "run.h"

static arrays a;

typedef struct kubo_user {
   double fault;  /* factor of the noise in whole steps */
   int code;      /* return code of the callbacks */
   int calls, most_lanes, fewest_lanes, gradients;
} kubo_user;

static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   kubo_user *u = user;
   (void)t;
   CHECK(ndof == 1 && nham == 2);
   u->gradients++;
   u->most_lanes = nlane > u->most_lanes ? nlane : u->most_lanes;
   u->fewest_lanes = nlane < u->fewest_lanes ? nlane : u->fewest_lanes;
   for (int i = 0; i < nlane; i++) {
      const double theta = w[i] + 0.3 * w[nlane + i];
      hq[i] = theta * q[i];
      hp[i] = theta * p[i];
   }
   return 0;
}

static int flow(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h, const double *w,
                const double *const *functionals, const double *q, const double *p, double *qn, double *pn,
                int64_t *status, void *user) {
   kubo_user *u = user;
   (void)t;
   u->calls++;
   CHECK(ndof == 1 && nham == 2 && nstep % every == 0 && max_iter > 0);
   CHECK(functionals[0] == NULL && functionals[3] == NULL);
   for (int i = 0; i < nlane; i++) {
      double x = q[i], y = p[i];
      for (int n = 0; n < nstep && status[i] == 0; n++) {
         const double half = 0.5 * (h + 0.3 * u->fault * w[(n * nham + 1) * nlane + i]);
         const double factor = 2 * half / (1 + half * half), dx = factor * (y - half * x),
                      dy = -factor * (x + half * y);
         x += dx;
         y += dy;
         if ((n + 1) % every == 0) {
            qn[n / every * nlane + i] = x;
            pn[n / every * nlane + i] = y;
         }
      }
   }
   return u->code;
}

static symsde_model new_user_kubo(kubo_user *user) {
   symsde_traits traits;
   symsde_model model;
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = traits.separable = traits.quadratic = 1;
   OK(symsde_model_new("kubo of a user", &traits, gradient, NULL, NULL, NULL, user, &model, &error));
   return model;
}

/* largest difference of the saved paths from those of the built-in model, kubo(1, 0.3) */
static double difference(symsde_model model, symsde_options options) {
   static arrays b;
   const symsde_input input = some_input(&one, &zero);
   symsde_paths mine = paths_in(&a, 0), theirs = paths_in(&b, 0);
   symsde_report report;
   symsde_model kubo = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   double largest = 0;

   symsde_report_init(&report);
   OK(symsde_simulate(model, scheme, &options, &input, &mine, &report, &error));
   OK(symsde_simulate(kubo, scheme, &options, &input, &theirs, &report, &error));
   for (int i = 0; i < NTIME * (int)options.paths; i++) {
      largest = fmax(largest, fmax(fabs(a.q[i] - b.q[i]), fabs(a.p[i] - b.p[i])));
   }
   symsde_model_delete(&kubo);
   symsde_scheme_delete(&scheme);
   return largest;
}

static void test_flow(void) {
   kubo_user user = {.fault = 1, .fewest_lanes = 1 << 30};
   symsde_model model = new_user_kubo(&user), kubo = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;

   symsde_report_init(&report);
   options.threads = 1;
   /* the Hessian is made of differences, and the user's functions are not called for it */
   CHECK(difference(model, options) < 1e-8);
   CHECK(user.calls == 0);
   OK(symsde_model_set_flow(model, "midpoint", flow, &error));
   CHECK(difference(model, options) < 1e-13);
   CHECK(user.calls > 0);
   user.calls = 0;
   OK(symsde_model_set_flow(model, "gauss2", flow, &error)); /* a flow of another scheme does not replace midpoint's */
   CHECK(difference(model, options) < 1e-13);
   CHECK(user.calls > 0);
   user.fault = 1.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "whole steps of scheme midpoint|not those of the library",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   user.fault = 1;
   user.code = 23;
   EXPECT(SYMSDE_FALSE_TRAIT, "whole steps", symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   user.code = 0;
   OK(symsde_model_set_flow(model, "midpoint", NULL, &error));
   user.calls = 0;
   CHECK(difference(model, options) < 1e-8);
   CHECK(user.calls == 0);
   EXPECT(SYMSDE_UNKNOWN_NAME, "midpiont", symsde_model_set_flow(model, "midpiont", flow, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "symplectic_euler_adjoint alone",
          symsde_model_set_flow(model, "midpoint, corrected", flow, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_set_flow(kubo, "midpoint", flow, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_set_flow(NULL, "midpoint", flow, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "scheme", symsde_model_set_flow(model, NULL, flow, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
   symsde_scheme_delete(&scheme);
}

/* H = p^2/2, H_1 = 0.3 p: errors of positions do not reach the momenta */
static int free_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                         double *hq, double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)q, (void)user;
   for (int i = 0; i < nlane; i++) {
      hq[i] = 0;
      hp[i] = w[i] * p[i] + 0.3 * w[nlane + i];
   }
   return 0;
}

static int free_flow(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h,
                     const double *w, const double *const *functionals, const double *q, const double *p, double *qn,
                     double *pn, int64_t *status, void *user) {
   (void)ndof, (void)max_iter, (void)t, (void)functionals, (void)status;
   for (int i = 0; i < nlane; i++) {
      double x = q[i];
      for (int n = 0; n < nstep; n++) {
         x += *(const double *)user * h * p[i] + 0.3 * w[(n * nham + 1) * nlane + i];
         if ((n + 1) % every == 0) {
            qn[n / every * nlane + i] = x;
            pn[n / every * nlane + i] = p[i];
         }
      }
   }
   return 0;
}

static void test_wrong_positions(void) {
   double velocity = 1;
   symsde_traits traits;
   symsde_model model;
   symsde_scheme scheme = new_scheme("midpoint");
   const symsde_options options = some_options();
   const symsde_input input = some_input(&one, &one);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;

   symsde_report_init(&report);
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = traits.separable = traits.quadratic = 1;
   OK(symsde_model_new("free particle", &traits, free_gradient, NULL, NULL, NULL, &velocity, &model, &error));
   OK(symsde_model_set_flow(model, "midpoint", free_flow, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   velocity = 1.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "whole steps of scheme midpoint|not those of the library|q_1",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* H = p^2/(2m) + k q^4/4, H_1 = s q of an ion: 1e-27 kg, 1e-6 m, 1e-7 s; the user pointer is a factor of the force */
static const double mass = 1e-27, stiffness = 0.1, push = 1e-23;

static int ion_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                        double *hq, double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * stiffness * q[i] * q[i] * q[i] + w[nlane + i] * push;
      hp[i] = w[i] * p[i] / mass;
   }
   return 0;
}

static int ion_flow(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h,
                    const double *w, const double *const *functionals, const double *q, const double *p, double *qn,
                    double *pn, int64_t *status, void *user) {
   const double force = *(const double *)user * stiffness;
   (void)ndof, (void)max_iter, (void)t, (void)functionals, (void)status;
   for (int i = 0; i < nlane; i++) {
      double x = q[i], y = p[i];
      for (int n = 0; n < nstep; n++) {
         const double dw = w[(n * nham + 1) * nlane + i];
         y -= (h * force * x * x * x + dw * push) / 2;
         x += h * y / mass;
         y -= (h * force * x * x * x + dw * push) / 2;
         if ((n + 1) % every == 0) {
            qn[n / every * nlane + i] = x;
            pn[n / every * nlane + i] = y;
         }
      }
   }
   return 0;
}

/* a displacement of one would throw ions out of the range of numbers, where nothing could be compared */
static void test_units_of_atoms(void) {
   const double length = 1e-6, momentum = 1e-26;
   double force = 1;
   symsde_traits traits;
   symsde_model model;
   symsde_scheme scheme = new_scheme("stormer_verlet");
   symsde_options options = some_options();
   const symsde_input input = some_input(&length, &momentum);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;

   options.step = 1e-8;
   symsde_report_init(&report);
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = traits.separable = traits.additive = traits.position_noise = 1;
   OK(symsde_model_new("ion", &traits, ion_gradient, NULL, NULL, NULL, &force, &model, &error));
   OK(symsde_model_set_flow(model, "stormer_verlet", ion_flow, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   force = 1.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "whole steps of scheme stormer_verlet|not those of the library",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* a single path: the model is called with eight lanes, or with one lane */
static void test_any_lanes(void) {
   kubo_user user = {.fault = 1, .fewest_lanes = 1 << 30};
   symsde_model model = new_user_kubo(&user), kubo = new_kubo();
   symsde_options options = some_options();

   options.paths = 1;
   options.threads = 1;
   CHECK(difference(model, options) < 1e-8);
   const int padded = user.fewest_lanes;
   OK(symsde_model_accept_any_lanes(model, &error));
   CHECK(difference(model, options) < 1e-8);
   CHECK(padded > 1 && user.fewest_lanes == 1);
   options.paths = 11;
   CHECK(difference(model, options) < 1e-8);
   OK(symsde_model_set_flow(model, "midpoint", flow, &error)); /* whole steps of the real lanes, without padding */
   CHECK(difference(model, options) < 1e-13);
   options.paths = 3;
   CHECK(difference(model, options) < 1e-13);
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_accept_any_lanes(kubo, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_accept_any_lanes(NULL, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
}

/* gradient calls of a run by whole steps: all are probes */
static int gradients_of_a_run(symsde_model model, kubo_user *user) {
   symsde_options options = some_options();

   options.threads = 1;
   user->gradients = 0;
   CHECK(difference(model, options) < 1e-13);
   return user->gradients;
}

/* a model of derived formulas is probed by one run, and again after a change; other models by every run */
static void test_derived(void) {
   kubo_user user = {.fault = 1, .fewest_lanes = 1 << 30};
   symsde_model model = new_user_kubo(&user), kubo = new_kubo();

   OK(symsde_model_set_flow(model, "midpoint", flow, &error));
   const int probed = gradients_of_a_run(model, &user);
   CHECK(gradients_of_a_run(model, &user) == probed);
   OK(symsde_model_set_derived(model, &error));
   CHECK(gradients_of_a_run(model, &user) == probed);
   const int known = gradients_of_a_run(model, &user);
   CHECK(known < probed / 4);
   OK(symsde_model_accept_null(model, &error));
   CHECK(gradients_of_a_run(model, &user) == probed);
   CHECK(gradients_of_a_run(model, &user) == known);
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_set_derived(kubo, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_set_derived(NULL, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
}

int main(void) {
   test_flow();
   test_wrong_positions();
   test_units_of_atoms();
   test_any_lanes();
   test_derived();
   return close_report();
}
