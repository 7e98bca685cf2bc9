/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Paths that a run of moments saves beside (paths of symsde_moments) are those of symsde_simulate, and its moments are
 * theirs; parts of them may be left out.
 */
#include "run.h"

enum { NVALUE = 3 };

static arrays a, b; /* of symsde_simulate, and beside moments */
static double t[NTIME], mean[NTIME * NVALUE], variance[NTIME * NVALUE], se[NTIME * NVALUE];
static int64_t n_ok[NTIME];
static symsde_moments m;

/* H = p^2/2 + 2 (q + 1.2)^(3/2)/3, H_1 = q, whose force is NaN for q < -1.2: some paths fail */
static int cliff_gradient(int nlane, int ndof, int nham, double time, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   (void)ndof, (void)nham, (void)time, (void)user;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * sqrt(q[i] + 1.2) + w[nlane + i];
      hp[i] = w[i] * p[i];
   }
   return 0;
}

static int cliff_value(int nlane, int ndof, int nham, double time, const double *w, const double *q, const double *p,
                       double *value, void *user) {
   (void)ndof, (void)nham, (void)time, (void)user;
   for (int i = 0; i < nlane; i++)
      value[i] = w[i] * (0.5 * p[i] * p[i] + 2.0 / 3.0 * pow(q[i] + 1.2, 1.5)) + w[nlane + i] * q[i];
   return 0;
}

static symsde_model new_cliff(void) {
   symsde_model model = NULL;
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = 1;
   traits.separable = traits.additive = traits.position_noise = traits.identity_mass = 1;
   OK(symsde_model_new("cliff", &traits, cliff_gradient, cliff_value, NULL, NULL, NULL, &model, &error));
   return model;
}

static void begin_moments(symsde_paths *paths) {
   symsde_moments_init(&m);
   m.t = t;
   m.n_ok = n_ok;
   m.mean = mean;
   m.variance = variance;
   m.se_mean = se;
   m.paths = paths;
}

static int same(const double *x, const double *y, size_t n) {
   for (size_t i = 0; i < n; i++)
      if (x[i] != y[i] && !(isnan(x[i]) && isnan(y[i])))
         return 0;
   return 1;
}

/* means and variances are those of the direct run's paths that are ok at each time */
static void check_moments(void) {
   for (int n = 0; n < NTIME; n++) {
      double sum[2] = {0, 0}, squares[2] = {0, 0};
      int64_t count = 0;
      for (int i = 0; i < PATHS; i++)
         if (!isnan(a.q[n * PATHS + i])) {
            count++;
            sum[0] += a.q[n * PATHS + i];
            sum[1] += a.p[n * PATHS + i];
         }
      CHECK(n_ok[n] == count && t[n] == a.t[n]);
      for (int k = 0; k < 2; k++) {
         const double *x = (k == 0 ? a.q : a.p) + n * PATHS, middle = sum[k] / (double)count;
         for (int i = 0; i < PATHS; i++)
            squares[k] += isnan(x[i]) ? 0 : (x[i] - middle) * (x[i] - middle);
         CHECK(fabs(mean[n * NVALUE + k] - middle) < 1e-13);
         CHECK(fabs(variance[n * NVALUE + k] - squares[k] / (double)(count - 1)) < 1e-12);
      }
   }
}

static void test_paths_beside(symsde_model model, const char *name, int compensated, int lanes, int outcome) {
   symsde_scheme scheme = new_scheme(name);
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths;

   options.first_path = 512;
   options.compensated = compensated;
   options.lanes = lanes;
   paths = paths_in(&a, 1);
   EXPECT(outcome, "", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   memset(&b, 0x55, sizeof b);
   paths = paths_in(&b, 1);
   begin_moments(&paths);
   EXPECT(outcome, "", symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error));
   check_moments();
   CHECK(same(a.t, b.t, NTIME) && same(a.q, b.q, NTIME * PATHS) && same(a.p, b.p, NTIME * PATHS));
   CHECK(same(a.last_q, b.last_q, PATHS) && same(a.last_p, b.last_p, PATHS));
   CHECK(same(a.q_low, b.q_low, PATHS) && same(a.p_low, b.p_low, PATHS));
   CHECK(memcmp(a.status, b.status, sizeof a.status) == 0);
   CHECK(memcmp(a.failed_step, b.failed_step, sizeof a.failed_step) == 0);
   for (int i = 0, nlow = 0; i < PATHS; i++) {
      nlow += a.q_low[i] != 0;
      if (i == PATHS - 1)
         CHECK(compensated ? nlow > PATHS / 2 : nlow == 0);
   }

   memset(&b, 0x55, sizeof b); /* without saved states: status and last states alone */
   paths = paths_in(&b, 1);
   paths.q = paths.p = NULL;
   paths.failed_step = NULL;
   begin_moments(&paths);
   EXPECT(outcome, "", symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error));
   check_moments();
   CHECK(same(a.last_q, b.last_q, PATHS) && same(a.last_p, b.last_p, PATHS) && same(a.t, b.t, NTIME));
   CHECK(same(a.q_low, b.q_low, PATHS) && same(a.p_low, b.p_low, PATHS));
   CHECK(memcmp(a.status, b.status, sizeof a.status) == 0 && b.failed_step[0] != a.failed_step[0]);
   symsde_scheme_delete(&scheme);
}

static void test_refusals(symsde_model model) {
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&b, 0);

   begin_moments(&paths);
   paths.status = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "status is NULL",
          symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error));
   paths = paths_in(&b, 0);
   paths.p = NULL; /* q without p is half of a state */
   EXPECT(SYMSDE_INVALID_ARGUMENT, "p is NULL",
          symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error));
   paths = paths_in(&b, 0);
   paths.q = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "q is NULL",
          symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error));
   paths.struct_size = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "symsde_paths_init first",
          symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error));
   symsde_scheme_delete(&scheme);
}

int main(void) {
   symsde_model kubo = new_kubo(), cliff = new_cliff();
   test_paths_beside(kubo, "midpoint", 0, 0, SYMSDE_OK);
   test_paths_beside(kubo, "midpoint", 1, 8, SYMSDE_OK);
   test_paths_beside(cliff, "stormer_verlet", 0, 0, SYMSDE_PATHS_FAILED);
   test_paths_beside(cliff, "stormer_verlet", 1, 8, SYMSDE_PATHS_FAILED);
   test_refusals(kubo);
   symsde_model_delete(&kubo);
   symsde_model_delete(&cliff);
   return close_report();
}
