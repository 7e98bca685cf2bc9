/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Parameters that differ from path to path: symsde_model_set_parameters, symsde_lanes, symsde_model_with_user, and the
 * noise that groups of paths share, noise_paths.
 */
#include "run.h"

static arrays a, b;
static double k[PATHS]; /* stiffness of each path; neighbours differ by much */

/* H = p^2/2 + k q^2/2, H_1 = -s q: k by path, s behind the user pointer */
static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   const symsde_lanes *lanes = user;
   const double s = *(const double *)lanes->user;
   (void)ndof, (void)nham, (void)t;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * lanes->parameters[i] * q[i] - w[nlane + i] * s;
      hp[i] = w[i] * p[i];
   }
   return 0;
}

/* the same gradient where k, too, is behind the user pointer, before s */
static int plain_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   const double *both = user;
   (void)ndof, (void)nham, (void)t;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * both[0] * q[i] - w[nlane + i] * both[1];
      hp[i] = w[i] * p[i];
   }
   return 0;
}

static symsde_model new_oscillator(symsde_gradient function, double *user) {
   symsde_model model = NULL;
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = 1;
   traits.separable = traits.additive = traits.position_noise = traits.identity_mass = traits.quadratic = 1;
   OK(symsde_model_new("by path", &traits, function, NULL, NULL, NULL, user, &model, &error));
   return model;
}

static void run(symsde_model model, const char *name, const symsde_options *options, arrays *results) {
   symsde_scheme scheme = NULL;
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(results, 0);
   OK(symsde_scheme_get(name, &scheme, &error));
   OK(symsde_simulate(model, scheme, options, &input, &paths, NULL, &error));
   symsde_scheme_delete(&scheme);
}

/* path i has the bits of a run of path i alone, and of a model whose user pointer has the value of path i */
static void test_paths(const char *scheme) {
   double s = 0.3, both[2] = {1, 0.3};
   symsde_model model = new_oscillator(gradient, &s), plain = new_oscillator(plain_gradient, both), other = NULL;
   symsde_options options = some_options();

   options.first_path = 256;
   OK(symsde_model_set_parameters(model, 1, PATHS, k, &error));
   run(model, scheme, &options, &a);
   for (int i = 0; i < PATHS; i += 23) {
      double mine[2] = {k[i], 0.3};
      options.paths = 1;
      options.first_path = 256 + i;
      OK(symsde_model_set_parameters(model, 1, 1, k + i, &error));
      run(model, scheme, &options, &b);
      for (int n = 0; n < NTIME; n++)
         CHECK(b.q[n] == a.q[n * PATHS + i] && b.p[n] == a.p[n * PATHS + i]);
      OK(symsde_model_with_user(plain, mine, NULL, &other, &error));
      run(other, scheme, &options, &b);
      symsde_model_delete(&other);
      for (int n = 0; n < NTIME; n++)
         CHECK(fabs(b.q[n] - a.q[n * PATHS + i]) < 1e-13);
   }
   symsde_model_delete(&model);
   symsde_model_delete(&plain);
}

/* points of an evaluation have the parameters of the paths; a single point, and probes, have those of the first path */
static void test_points(void) {
   double s = 0.3, w[2 * PATHS], q[PATHS], p[PATHS], hq[PATHS];
   symsde_model model = new_oscillator(gradient, &s);
   for (int i = 0; i < PATHS; i++) {
      w[i] = q[i] = 1;
      w[PATHS + i] = p[i] = 0;
   }
   OK(symsde_model_set_parameters(model, 1, PATHS, k, &error));
   OK(symsde_model_gradient(model, PATHS, 0, w, q, p, hq, NULL, &error));
   for (int i = 0; i < PATHS; i++)
      CHECK(hq[i] == k[i]);
   w[1] = 0;
   OK(symsde_model_gradient(model, 1, 0, w, q, p, hq, NULL, &error));
   CHECK(hq[0] == k[0]);
   OK(symsde_model_probe(model, 0, &one, &zero, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "parameters for 300 paths|there are 2 points",
          symsde_model_gradient(model, 2, 0, w, q, p, hq, NULL, &error));
   symsde_model_delete(&model);
}

static void test_refusals(void) {
   double s = 0.3;
   symsde_model model = new_oscillator(gradient, &s), other = NULL, kubo = new_kubo();
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);

   OK(symsde_scheme_get("midpoint", &scheme, &error));
   OK(symsde_model_set_parameters(model, 1, 7, k, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "parameters for 7 paths|run has 300",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nrow = 0", symsde_model_set_parameters(model, 1, 0, k, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nparameter = -1", symsde_model_set_parameters(model, -1, 1, k, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "values", symsde_model_set_parameters(model, 1, 1, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "built in", symsde_model_set_parameters(kubo, 1, 1, k, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "built in", symsde_model_with_user(kubo, &s, NULL, &other, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "made", symsde_model_with_user(model, &s, NULL, NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_with_user(NULL, &s, NULL, &other, &error));
   options.noise_paths = -1;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "noise_paths = -1",
          symsde_simulate(kubo, scheme, &options, &input, &paths, NULL, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
   symsde_scheme_delete(&scheme);
}

/* groups of paths have the noise of the first group: the same model, so the same bits */
static void test_noise_paths(void) {
   symsde_model model = new_kubo();
   symsde_options options = some_options();

   options.first_path = 512;
   run(model, "midpoint", &options, &b);
   options.noise_paths = 70;
   run(model, "midpoint", &options, &a);
   for (int n = 0; n < NTIME; n++)
      for (int i = 0; i < PATHS; i++)
         CHECK(a.q[n * PATHS + i] == b.q[n * PATHS + i % 70]);
   CHECK(a.q[PATHS + 70] != b.q[PATHS + 70]);
   symsde_model_delete(&model);
}

int main(void) {
   const char *schemes[] = {"midpoint", "stormer_verlet", "gauss2", "heun"};
   for (int i = 0; i < PATHS; i++)
      k[i] = 1 + 0.4 * sin(1.3 * i);
   for (int i = 0; i < 4; i++)
      test_paths(schemes[i]);
   test_points();
   test_refusals();
   test_noise_paths();
   return close_report();
}
