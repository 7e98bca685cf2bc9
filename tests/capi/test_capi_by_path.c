/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Parameters that differ from path to path: symsde_model_set_parameters, symsde_lanes, symsde_model_with_user,
 * symsde_model_get_by_path of built-in models, rows that neighbours share, row_paths, and the noise that groups of paths
 * share, noise_paths.
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

/* H = p^2/2 + q^2/2, H_1 = -q cos((k - 1) t) */
static int in_time(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                   double *hq, double *hp, void *user) {
   const symsde_lanes *lanes = user;
   (void)ndof, (void)nham;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * q[i] - w[nlane + i] * cos((lanes->parameters[i] - 1) * t);
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

/* a built-in model: path i has the bits of a run of path i alone with an array of one, and, to rounding, those of a run of
 * the model with its numbers; in a heat bath and with damping, too */
static void test_built_in(const char *name, const char *const *keys, const char *scheme, int open) {
   static double values[2 * PATHS];
   symsde_options options = some_options();
   symsde_model model = NULL;
   double apart = 0, moved = 0;
   const double gamma = 0.4, beta = 2;

   for (int i = 0; i < PATHS; i++) {
      values[i] = k[i];
      values[PATHS + i] = 0.3 + 0.2 * cos(0.7 * i);
   }
   options.first_path = 256;
   for (int i = -1; i < PATHS; i += i < 0 ? 1 : 37) { /* all paths, then some of them by themselves */
      const double one_row[] = {values[i < 0 ? 0 : i], values[PATHS + (i < 0 ? 0 : i)]};
      for (int plain = 0; plain < (i < 0 ? 1 : 2); plain++) {
         if (plain)
            OK(symsde_model_get(name, 2, keys, one_row, &model, &error));
         else
            OK(symsde_model_get_by_path(name, 2, keys, i < 0 ? PATHS : 1, i < 0 ? values : one_row, &model, &error));
         if (open == 1)
            OK(symsde_model_set_damping(model, 1, &gamma, 0, &error));
         if (open == 2)
            OK(symsde_model_thermostat(model, 1, &gamma, 1, &beta, &error));
         options.paths = i < 0 ? PATHS : 1;
         options.first_path = 256 + (i < 0 ? 0 : i);
         run(model, scheme, &options, i < 0 ? &a : &b);
         symsde_model_delete(&model);
         for (int n = 0; i >= 0 && n < NTIME; n++) {
            const double dq = fabs(b.q[n] - a.q[n * PATHS + i]), dp = fabs(b.p[n] - a.p[n * PATHS + i]);
            if (plain)
               apart = fmax(apart, fmax(dq, dp));
            else
               CHECK(dq == 0 && dp == 0);
            moved = fmax(moved, fabs(b.q[n] - 1));
         }
      }
   }
   CHECK(apart < 1e-12 && moved > 0.1);
}

/* built-in models by path: points of an evaluation have the parameters of the paths; bad input is refused */
static void test_built_in_points_and_refusals(void) {
   const char *const a_key[] = {"a"}, *const wrong[] = {"omega"}, *const twice[] = {"a", "a"}, *const nu[] = {"nu"};
   static double w[2 * PATHS], q[PATHS], p[PATHS], hq[PATHS], two[2] = {1, 2}, huge[2] = {1, 1e200}, bad[2] = {1, 0};
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);

   for (int i = 0; i < PATHS; i++)
      w[i] = q[i] = 1;
   OK(symsde_model_get_by_path("kubo", 1, a_key, PATHS, k, &model, &error));
   OK(symsde_model_gradient(model, PATHS, 0, w, q, p, hq, NULL, &error));
   for (int i = 0; i < PATHS; i++)
      CHECK(hq[i] == k[i]);
   symsde_model_delete(&model);
   OK(symsde_model_get_by_path("kubo", 1, a_key, 7, k, &model, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "kubo has parameters for 7 paths|run has 300|one for all",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "built in", symsde_model_set_parameters(model, 1, 7, k, &error));
   symsde_model_delete(&model);
   bad[1] = NAN;
   EXPECT(SYMSDE_UNKNOWN_NAME, "no parameter 'omega'|sigma",
          symsde_model_get_by_path("kubo", 1, wrong, 2, two, &model, &error));
   EXPECT(SYMSDE_UNKNOWN_NAME, "no model 'kobu'|kubo",
          symsde_model_get_by_path("kobu", 1, a_key, 2, two, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "given twice", symsde_model_get_by_path("kubo", 2, twice, 1, two, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "parameter a of model 'kubo' is NaN in row 2|finite",
          symsde_model_get_by_path("kubo", 1, a_key, 2, bad, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "omega of model 'synchrotron' is 1e200 in row 2",
          symsde_model_get_by_path("synchrotron", 1, wrong, 2, huge, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nu of model 'driven_pendulum' is NaN in row 2",
          symsde_model_get_by_path("driven_pendulum", 1, nu, 2, bad, &model, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "nu of model 'driven_pendulum' is no factor|same number for all paths",
          symsde_model_get_by_path("driven_pendulum", 1, nu, 2, two, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nparameter = 1, nrow = 0",
          symsde_model_get_by_path("kubo", 1, a_key, 0, k, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nparameter = 0, nrow = 2|symsde_model_get",
          symsde_model_get_by_path("kubo", 0, NULL, 2, k, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nparameter = -1",
          symsde_model_get_by_path("kubo", -1, a_key, 2, k, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "values", symsde_model_get_by_path("kubo", 1, a_key, 2, NULL, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "keys", symsde_model_get_by_path("kubo", 1, NULL, 2, k, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "name", symsde_model_get_by_path(NULL, 1, a_key, 2, k, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "model", symsde_model_get_by_path("kubo", 1, a_key, 2, k, NULL, &error));
   EXPECT(SYMSDE_TOO_LARGE, "values", symsde_model_get_by_path("kubo", 1, a_key, INT64_MAX, k, &model, &error));
   CHECK(model == NULL);
   symsde_scheme_delete(&scheme);
}

/* H = p^2/(2 m) + k q^2/2: k and 1/m by path */
static int heavy_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   const symsde_lanes *lanes = user;
   (void)ndof, (void)nham, (void)t;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * lanes->parameters[i] * q[i];
      hp[i] = w[i] * lanes->parameters[nlane + i] * p[i];
   }
   return 0;
}

/* a bath takes the mass of all paths, whatever else goes by path: path i is that of the model with its row, and its noise
 * that of the mass 1/inverse; the mass of a single path that differs is refused */
static void test_mass_in_bath(void) {
   static double values[2 * PATHS];
   const double gamma = 0.4, beta = 2, inverse = 0.7, w[] = {0, 1};
   double hq, first = 0;
   symsde_model model = NULL;
   symsde_options options = some_options();
   symsde_traits traits;

   for (int i = 0; i < PATHS; i++) {
      values[i] = k[i];
      values[PATHS + i] = inverse;
   }
   symsde_traits_init(&traits);
   traits.ndof = 1;
   traits.separable = traits.additive = traits.position_noise = traits.constant_mass = traits.quadratic = 1;
   for (int i = -1; i < PATHS; i += i < 0 ? 1 : 37) {
      const double row[] = {values[i < 0 ? 0 : i], inverse};
      OK(symsde_model_new("heavy", &traits, heavy_gradient, NULL, NULL, NULL, NULL, &model, &error));
      OK(symsde_model_set_parameters(model, 2, i < 0 ? PATHS : 1, i < 0 ? values : row, &error));
      OK(symsde_model_thermostat(model, 1, &gamma, 1, &beta, &error));
      options.paths = i < 0 ? PATHS : 1;
      options.first_path = i < 0 ? 0 : i;
      run(model, "chin4a", &options, i < 0 ? &a : &b);
      for (int n = 0; i >= 0 && n < NTIME; n++)
         CHECK(a.q[n * PATHS + i] == b.q[n] && a.p[n * PATHS + i] == b.p[n]);
      if (i == 0) {
         OK(symsde_model_gradient(model, 1, 0, w, &one, &zero, &hq, NULL, &error));
         CHECK(fabs(hq * hq - 2 * gamma / (inverse * beta)) < 1e-14 && hq < 0);
         first = b.q[NTIME - 1];
      }
      symsde_model_delete(&model);
   }
   CHECK(first == a.q[(NTIME - 1) * PATHS]);
   values[2 * PATHS - 1] = 0.71;
   OK(symsde_model_new("heavy", &traits, heavy_gradient, NULL, NULL, NULL, NULL, &model, &error));
   OK(symsde_model_set_parameters(model, 2, PATHS, values, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "masses of model heavy differ from path to path|for each mass",
          symsde_model_thermostat(model, 1, &gamma, 1, &beta, &error));
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

/* neighbours that share a row have the bits of the run whose table repeats the rows, and of each path alone with its row */
static void test_row_paths(symsde_model model, int built_in, int each, int lanes) {
   static double repeated[PATHS];
   const char *const key[] = {"a"};
   const int nrow = PATHS / each;
   symsde_options options = some_options();

   for (int i = 0; i < PATHS; i++)
      repeated[i] = k[i / each];
   options.first_path = 512;
   options.lanes = lanes;
   for (int i = -2; i < PATHS; i += i < 0 ? 1 : 41) { /* shared rows, repeated rows, and then some paths alone */
      const int count = i == -2 ? nrow : i == -1 ? PATHS : 1;
      const double *values = i == -2 ? k : i == -1 ? repeated : k + i / each;
      if (built_in)
         OK(symsde_model_get_by_path("kubo", 1, key, count, values, &model, &error));
      else
         OK(symsde_model_set_parameters(model, 1, count, values, &error));
      options.row_paths = i == -2 ? each : 1;
      options.paths = i < 0 ? PATHS : 1;
      options.first_path = 512 + (i < 0 ? 0 : i);
      run(model, "midpoint", &options, i == -2 ? &a : &b);
      if (built_in)
         symsde_model_delete(&model);
      for (int n = 0; n < NTIME && i == -1; n++)
         for (int j = 0; j < PATHS; j++)
            CHECK(a.q[n * PATHS + j] == b.q[n * PATHS + j] && a.p[n * PATHS + j] == b.p[n * PATHS + j]);
      for (int n = 0; n < NTIME && i >= 0; n++)
         CHECK(a.q[n * PATHS + i] == b.q[n] && a.p[n * PATHS + i] == b.p[n]);
   }
}

static void test_wrong_row_paths(symsde_model model) {
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);

   OK(symsde_model_set_parameters(model, 1, 42, k, &error)); /* 42 rows of 7 paths each: 294 paths, not 300 */
   options.row_paths = 7;
   EXPECT(SYMSDE_WRONG_SHAPE, "parameters for 294 paths|run has 300",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   options.row_paths = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "row_paths = 0", symsde_options_check(&options, &error));
   OK(symsde_model_set_parameters(model, 1, 1, k, &error)); /* one row is for all paths, whatever they share */
   options.row_paths = 1;
   run(model, "midpoint", &options, &b);
   options.row_paths = 7;
   run(model, "midpoint", &options, &a);
   CHECK(memcmp(a.q, b.q, NTIME * PATHS * sizeof *a.q) == 0);
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
   static double dw[STEPS][PATHS];
   OK(symsde_increments(model, NULL, &options, &dw[0][0], &error));
   for (int n = 0; n < STEPS; n++)
      for (int i = 70; i < PATHS; i++)
         CHECK(dw[n][i] == dw[n][i % 70]);
   symsde_model_delete(&model);
}

/* the noise of the last path alone changes in time */
static void test_noise_in_time(void) {
   symsde_model model = new_oscillator(in_time, NULL);
   symsde_options options = some_options();
   double rates[PATHS], last = 3;
   for (int i = 0; i < PATHS; i++)
      rates[i] = i == PATHS - 1 ? last : 1;
   OK(symsde_model_set_parameters(model, 1, PATHS, rates, &error));
   run(model, "verlet_dz", &options, &a);
   OK(symsde_model_set_parameters(model, 1, 1, &last, &error));
   run(model, "verlet_dz", &options, &b);
   for (int n = 0; n < NTIME; n++)
      CHECK(a.q[n * PATHS + PATHS - 1] == b.q[n * PATHS + PATHS - 1]);
   symsde_model_delete(&model);
}

int main(void) {
   const char *schemes[] = {"midpoint", "stormer_verlet", "gauss2", "heun"};
   const char *const pendulum[] = {"omega", "sigma1"}, *const oscillator[] = {"a", "sigma"};
   for (int i = 0; i < PATHS; i++)
      k[i] = 1 + 0.4 * sin(1.3 * i);
   for (int i = 0; i < 4; i++)
      test_paths(schemes[i]);
   test_points();
   test_built_in("synchrotron", pendulum, "stormer_verlet", 0);
   test_built_in("synchrotron", pendulum, "gauss2", 1);
   test_built_in("synchrotron", pendulum, "gauss_dkdkd", 2);
   test_built_in("kubo", oscillator, "midpoint", 0);
   test_built_in_points_and_refusals();
   test_mass_in_bath();
   test_refusals();
   test_noise_paths();
   test_noise_in_time();
   double s = 0.3;
   symsde_model model = new_oscillator(gradient, &s);
   test_row_paths(model, 0, 5, 0);
   test_row_paths(model, 0, 100, 8);
   test_row_paths(NULL, 1, 3, 0);
   test_wrong_row_paths(model);
   symsde_model_delete(&model);
   return close_report();
}
