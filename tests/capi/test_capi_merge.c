/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Parts of an ensemble through the C interface: they merge to the bits of the whole.
 */
#include "run.h"

/* moments of paths 0 .. 255 and 256 .. 299 merge to the bits of all 300 */
static void test_merge_moments(void) {
   enum { NVALUE = 3, N = NTIME * NVALUE };
   static double t[NTIME], mean[3][N], variance[N], se[N], m2[3][N];
   static int64_t n_ok[3][NTIME];
   const int64_t first[3] = {0, 256, 0}, count[3] = {256, PATHS - 256, PATHS};
   double q0 = 0.3, p0 = -0.4, found[N], deviation[N];
   symsde_model model = new_kubo();
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   symsde_input input = some_input(&q0, &p0);
   symsde_moments *m = malloc(sizeof *m);

   OK(symsde_scheme_get("midpoint", &scheme, &error));
   symsde_moments_init(m);
   m->t = t;
   m->variance = variance;
   m->se_mean = se;
   for (int part = 0; part < 3; part++) {
      options.first_path = first[part];
      options.paths = count[part];
      m->n_ok = n_ok[part];
      m->mean = mean[part];
      m->m2 = m2[part];
      OK(symsde_compute_moments(model, scheme, &options, &input, m, NULL, &error));
   }
   for (int i = 1; i < N; i++) {
      CHECK(fabs(m2[2][i] - variance[i] * (PATHS - 1)) <= 1e-13 * m2[2][i]);
   }
   OK(symsde_merge_moments(NTIME, NVALUE, n_ok[0], mean[0], m2[0], n_ok[1], mean[1], m2[1], &error));
   CHECK(memcmp(n_ok[0], n_ok[2], sizeof n_ok[0]) == 0);
   CHECK(memcmp(mean[0], mean[2], sizeof mean[0]) == 0 && memcmp(m2[0], m2[2], sizeof m2[0]) == 0);
   OK(symsde_moment_errors(NTIME, NVALUE, n_ok[0], mean[0], m2[0], found, deviation, &error));
   CHECK(memcmp(found, variance, sizeof found) == 0 && memcmp(deviation, se, sizeof se) == 0);
   CHECK(memcmp(mean[0], mean[2], sizeof mean[0]) == 0);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "se_mean is NULL",
          symsde_moment_errors(NTIME, NVALUE, n_ok[0], mean[0], m2[0], found, NULL, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "negative",
          symsde_moment_errors(NTIME, -1, n_ok[0], mean[0], m2[0], found, deviation, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "m2_right is NULL",
          symsde_merge_moments(NTIME, NVALUE, n_ok[0], mean[0], m2[0], n_ok[1], mean[1], NULL, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "negative",
          symsde_merge_moments(-1, NVALUE, n_ok[0], mean[0], m2[0], n_ok[1], mean[1], m2[1], &error));
   free(m);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* at each time in turn one part has no paths and NaN means; merging leaves the other part's numbers */
static void test_merge_nothing(void) {
   enum { NVALUE = 2, N = NTIME * NVALUE };
   double mean[2][N], m2[2][N];
   int64_t n_ok[2][NTIME];

   for (int lost = 0; lost < NTIME; lost++) {
      for (int part = 0; part < 2; part++) {
         for (int i = 0; i < N; i++) {
            const int gone = part == 1 && i / NVALUE == lost;
            n_ok[part][i / NVALUE] = gone ? 0 : 256;
            mean[part][i] = gone ? NAN : i;
            m2[part][i] = gone ? NAN : 2 * i;
         }
      }
      OK(symsde_merge_moments(NTIME, NVALUE, n_ok[0], mean[0], m2[0], n_ok[1], mean[1], m2[1], &error));
      for (int i = 0; i < N; i++) {
         CHECK(mean[0][i] == i && m2[0][i] == (i / NVALUE == lost ? 2 : 4) * i);
         CHECK(n_ok[0][i / NVALUE] == (i / NVALUE == lost ? 256 : 512));
      }
   }
}

/* no path has a mean, and one path no variance */
static void test_errors_of_few(void) {
   enum { NVALUE = 2 };
   const int64_t n_ok[3] = {0, 1, 3};
   double mean[6] = {1, 1, 1, 1, 1, 1}, variance[6], se[6];
   const double m2[6] = {8, 8, 8, 8, 8, 8};

   OK(symsde_moment_errors(3, NVALUE, n_ok, mean, m2, variance, se, &error));
   for (int i = 0; i < 6; i++) {
      CHECK(isnan(mean[i]) == (i < 2) && isnan(variance[i]) == (i < 4) && isnan(se[i]) == (i < 4));
      CHECK(i < 4 || (variance[i] == 4 && se[i] == sqrt(4.0 / 3)));
   }
}

int main(void) {
   test_merge_moments();
   test_merge_nothing();
   test_errors_of_few();
   return close_report();
}
