/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A user's chain by rows, symsde_model_set_chain_rows: the paths of the same chain with a dense Hessian by differences,
 * and of the built-in one; wrong rows and models that are no chains are refused.
 */
#include "run.h"

enum { NDOF = 37, NPATH = 21, NSTEP = 30 };

typedef struct chain_user {
   double beta, sigma;
   double wrong_force, wrong_diagonal, wrong_beside; /* error added by the rows */
   double refuse_after;                              /* from this time on rows return the error code 29 */
   int rows;                                         /* calls */
} chain_user;

/* H = sum p_i^2/2 + sum r_i^2/2 + beta r_i^4/4, r_i = q_{i+1} - q_i between walls; H_i = sigma q_i */
static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   const chain_user *u = user;
   (void)t, (void)nham;
   for (int i = 0; i < ndof; i++) {
      for (int l = 0; l < nlane; l++) {
         const double left = q[i * nlane + l] - (i > 0 ? q[(i - 1) * nlane + l] : 0);
         const double right = (i < ndof - 1 ? q[(i + 1) * nlane + l] : 0) - q[i * nlane + l];
         if (hq != NULL) {
            hq[i * nlane + l] = w[l] * (left + u->beta * left * left * left - right - u->beta * right * right * right) -
                                u->sigma * w[(i + 1) * nlane + l];
         }
         if (hp != NULL) {
            hp[i * nlane + l] = w[l] * p[i * nlane + l];
         }
      }
   }
   return 0;
}

static int rows(int nlane, int ndof, int nham, int first, int last, double t, const double *w, const double *q,
                double *hq, double *hqq, void *user) {
   chain_user *u = user;
   if (t > u->refuse_after || nham != ndof + 1) {
      return 29;
   }
   u->rows++;
   for (int i = first; i <= last; i++) {
      const double *row = q + (i - first + 1) * nlane;
      double *force = hq + (i - first) * nlane, *diagonal = hqq + 2 * (i - first) * nlane, *beside = diagonal + nlane;
      for (int l = 0; l < nlane; l++) {
         const double left = row[l] - row[l - nlane], right = row[l + nlane] - row[l];
         const double k = 1 + 3 * u->beta * left * left, next = 1 + 3 * u->beta * right * right;
         force[l] = w[l] * (left * (1 + u->beta * left * left) - right * (1 + u->beta * right * right)) -
                    u->sigma * w[(i + 1) * nlane + l] + u->wrong_force;
         diagonal[l] = w[l] * (k + next) + u->wrong_diagonal;
         beside[l] = -w[l] * next + u->wrong_beside;
      }
   }
   return 0;
}

static symsde_model new_chain(chain_user *user, int bandwidth) {
   symsde_model model = NULL;
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = NDOF;
   traits.bandwidth = bandwidth;
   traits.separable = traits.additive = traits.identity_mass = 1;
   OK(symsde_model_new("my chain", &traits, gradient, NULL, NULL, NULL, user, &model, &error));
   return model;
}

static double last_q[2][NDOF * NPATH];

static int run(symsde_model model, const char *name, double *last) {
   static double t[2], q[2 * NDOF * NPATH], p[2 * NDOF * NPATH], last_p[NDOF * NPATH];
   static int32_t status[NPATH];
   static int64_t failed_step[NPATH];
   double q0[NDOF], p0[NDOF];
   symsde_scheme scheme = new_scheme(name);
   symsde_options options;
   symsde_input input;
   symsde_paths paths;

   for (int i = 0; i < NDOF; i++) {
      q0[i] = sin(0.3 * i);
      p0[i] = 0;
   }
   symsde_options_init(&options);
   options.step = 0.2;
   options.steps = options.save_every = NSTEP;
   options.paths = NPATH;
   options.seed = 3;
   options.threads = 1;
   input = some_input(q0, p0);
   symsde_paths_init(&paths);
   paths.t = t;
   paths.q = q;
   paths.p = p;
   paths.status = status;
   paths.failed_step = failed_step;
   paths.last_q = last;
   paths.last_p = last_p;
   const int outcome = symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error);
   symsde_scheme_delete(&scheme);
   return outcome;
}

static double distance(void) {
   double largest = 0;
   for (int i = 0; i < NDOF * NPATH; i++) {
      largest = fmax(largest, fabs(last_q[0][i] - last_q[1][i]));
   }
   return largest;
}

static void test_equals_dense_and_built_in(void) {
   const char *const keys[] = {"n", "beta", "sigma"};
   const double values[] = {NDOF, 0.7, 0.1};
   chain_user user = {0.7, 0.1, 0, 0, 0, 1e9, 0};
   symsde_model dense = new_chain(&user, -1), chain = new_chain(&user, 1), built_in = NULL;

   OK(symsde_model_get("fpu_chain", 3, keys, values, &built_in, &error));
   OK(symsde_model_set_chain_rows(chain, rows, &error));
   OK(run(dense, "midpoint", last_q[0]));
   CHECK(user.rows == 0);
   OK(run(chain, "midpoint", last_q[1]));
   CHECK(user.rows > NSTEP && distance() < 1e-11);
   OK(run(built_in, "midpoint", last_q[0]));
   CHECK(distance() < 1e-12 && fabs(last_q[0][5]) > 1e-3);
   OK(run(chain, "gauss2", last_q[1])); /* gauss2 computes whole blocks from rows */
   OK(run(built_in, "gauss2", last_q[0]));
   CHECK(distance() < 1e-11);
   user.rows = 0;
   OK(symsde_model_set_chain_rows(chain, NULL, &error));
   OK(run(chain, "midpoint", last_q[1]));
   CHECK(user.rows == 0);
   symsde_model_delete(&dense);
   symsde_model_delete(&chain);
   symsde_model_delete(&built_in);
}

static void test_refusals(void) {
   chain_user user = {0.7, 0.1, 0, 0, 0, 1e9, 0};
   symsde_model dense = new_chain(&user, -1), chain = new_chain(&user, 1), kubo = new_kubo();

   EXPECT(SYMSDE_INCOMPATIBLE, "bandwidth 1", symsde_model_set_chain_rows(dense, rows, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "built in", symsde_model_set_chain_rows(kubo, rows, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_set_chain_rows(NULL, rows, &error));
   OK(run(dense, "stormer_verlet", last_q[0]));
   OK(symsde_model_set_chain_rows(chain, rows, &error));
   user.wrong_force = 1e-3;
   EXPECT(SYMSDE_FALSE_TRAIT, "rows whose force", run(chain, "midpoint", last_q[0]));
   user.wrong_force = 0;
   user.wrong_diagonal = 0.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "rows whose diagonal", run(chain, "midpoint", last_q[0]));
   user.wrong_diagonal = 0;
   user.wrong_beside = 0.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "beside the diagonal", run(chain, "midpoint", last_q[0]));
   user.wrong_beside = 0;
   user.refuse_after = 1;
   EXPECT(SYMSDE_CALLBACK_FAILED, "29", run(chain, "midpoint", last_q[0]));
   user.refuse_after = 1e9;
   OK(run(chain, "midpoint", last_q[0]));
   symsde_model_delete(&dense);
   symsde_model_delete(&chain);
   symsde_model_delete(&kubo);
}

int main(void) {
   test_equals_dense_and_built_in();
   test_refusals();
   return close_report();
}
