/* SPDX-License-Identifier: BSD-3-Clause
 *
 * How linear flows between kicks change with a parameter, as a user tells it: right slopes give the derivative of runs,
 * in any units, and slopes that are wrong by one per cent are refused.
 */
#include "run.h"

/* H = k sum_d (a p_d^2 + 2 c q_d p_d + b q_d^2)/2 and H_1 = -s sum_d q_d, with k here, or as last position of the wide
 * model */
typedef struct spring {
   double a, b, c, s, k;
} spring;

/* sizes of lengths, momenta, times and of k, in units of those that tests are written in */
typedef struct units {
   double length, momentum, time, k;
} units;

enum { FEW = 8, DOFS = 5 };

static arrays run;
static double value[FEW], by_q[(DOFS + 1) * FEW], by_p[DOFS * FEW];
static int32_t status[FEW];
static int64_t failed_step[FEW];

static int gradient(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *hq,
                    double *hp, void *user) {
   const spring *x = user;

   (void)nham, (void)t;
   for (int i = 0; i < n; i++) {
      const int wide = DOFS * n + i;
      const double k = ndof > DOFS ? q[wide] : x->k;
      double energy = 0;
      for (int d = i; d < DOFS * n; d += n) {
         hq[d] = w[i] * k * (x->b * q[d] + x->c * p[d]) - w[n + i] * x->s;
         hp[d] = w[i] * k * (x->a * p[d] + x->c * q[d]);
         energy += (x->a * p[d] * p[d] + 2 * x->c * q[d] * p[d] + x->b * q[d] * q[d]) / 2;
      }
      if (ndof > DOFS) {
         hq[wide] = w[i] * energy;
         hp[wide] = 0;
      }
   }
   return 0;
}

static int product(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                   const double *vq, const double *vp, double *uq, double *up, void *user) {
   const spring *x = user;

   (void)nham, (void)t;
   CHECK(ndof == DOFS + 1);
   for (int i = 0; i < n; i++) {
      const int wide = DOFS * n + i;
      uq[wide] = up[wide] = 0;
      for (int d = i; d < DOFS * n; d += n) {
         const double q1 = x->b * q[d] + x->c * p[d], p1 = x->a * p[d] + x->c * q[d];
         uq[d] = w[i] * (q[wide] * (x->b * vq[d] + x->c * vp[d]) + vq[wide] * q1);
         up[d] = w[i] * (q[wide] * (x->a * vp[d] + x->c * vq[d]) + vq[wide] * p1);
         uq[wide] += w[i] * (q1 * vq[d] + p1 * vp[d]);
      }
   }
   return 0;
}

/* f = the last position at the end */
static int last_q(int64_t first, int lanes, int ndof, int ntime, int nparameter, const double *t, const double *q,
                  const double *p, double *f, double *fq, double *fp, double *fparameter, void *user) {
   const int at = (ntime * ndof - 1) * lanes;

   (void)first, (void)nparameter, (void)t, (void)p, (void)fp, (void)fparameter, (void)user;
   for (int i = 0; i < lanes; i++) {
      f[i] = q[at + i];
      fq[at + i] = 1;
   }
   return 0;
}

static spring spring_in(units u) {
   return (spring){1.1 * u.length / (u.momentum * u.time * u.k), 0.9 * u.momentum / (u.length * u.time * u.k),
                   0.3 / (u.time * u.k), 0.2 * u.momentum / sqrt(u.time), 1.3 * u.k};
}

static symsde_model new_spring(spring *own, int wide) {
   symsde_model model = NULL;
   symsde_traits traits;

   symsde_traits_init(&traits);
   traits.nnoise = traits.position_noise = 1;
   traits.ndof = DOFS + wide;
   traits.has_hessian_vector = wide;
   traits.identity_mass = !wide && fabs(own->a * own->k - 1) <= 0;
   OK(symsde_model_new(wide ? "wide" : "spring", &traits, gradient, NULL, NULL, wide ? product : NULL, own, &model,
                       &error));
   return model;
}

static symsde_options few_steps(units u) {
   symsde_options options = some_options();
   options.step *= u.time;
   options.paths = FEW;
   return options;
}

/* Second derivatives by (q, p) of factor times the sum of b q_d^2/2 + c q_d p_d + a p_d^2/2. */
static void fill(const spring *x, double factor, double second[2 * DOFS][2 * DOFS]) {
   memset(second, 0, sizeof(double[2 * DOFS][2 * DOFS]));
   for (int d = 0; d < DOFS; d++) {
      second[d][d] = factor * x->b;
      second[DOFS + d][DOFS + d] = factor * x->a;
      second[d][DOFS + d] = second[DOFS + d][d] = factor * x->c;
   }
}

static void start_from(double q, double *q0, double *p0) {
   for (int d = 0; d < DOFS; d++) {
      q0[d] = q;
      p0[d] = 0;
   }
}

/* The last position at the end by the spring k, in units of length, whose flow stands between kicks */
static void run_spring(const char *name, units u, double k, double *last) {
   double q0[DOFS], p0[DOFS], second[2 * DOFS][2 * DOFS];
   spring own = spring_in(u);
   own.k = k * u.k;
   symsde_model model = new_spring(&own, 0);
   symsde_scheme scheme = new_scheme(name);
   symsde_options options = few_steps(u);
   symsde_input input = some_input(q0, p0);
   symsde_paths paths = paths_in(&run, 1);

   start_from(u.length, q0, p0);
   fill(&own, own.k, second);
   OK(symsde_model_set_quadratic_part(model, &second[0][0], &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   for (int i = 0; i < FEW; i++) {
      last[i] = run.last_q[(DOFS - 1) * FEW + i] / u.length;
   }
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&model);
}

/* The gradient by k with right slopes, but for entries of the last degree of freedom, which are multiples of them. */
static int gradient_by(const char *name, units u, const double multiple[2][2]) {
   double q0[DOFS], p0[DOFS], second[2 * DOFS][2 * DOFS], told[2 * DOFS][2 * DOFS];
   const int last = DOFS - 1;
   spring own = spring_in(u);
   symsde_model model = new_spring(&own, 0), wide = new_spring(&own, 1);
   symsde_scheme scheme = new_scheme(name);
   symsde_options options = few_steps(u);
   symsde_input input = some_input(q0, p0);

   start_from(u.length, q0, p0);
   fill(&own, own.k, second);
   fill(&own, 1, told);
   for (int i = 0; i < 2; i++) {
      for (int j = 0; j < 2; j++) {
         told[last + i * DOFS][last + j * DOFS] *= multiple[i][j];
      }
   }
   OK(symsde_model_set_quadratic_part(model, &second[0][0], &error));
   int code = symsde_model_set_flow_slopes(wide, DOFS, &told[0][0], NULL, &error);
   if (code == SYMSDE_OK) {
      code = symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &own.k, last_q, NULL, value, by_q, by_p,
                                  status, failed_step, NULL, &error);
   }
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&wide);
   symsde_model_delete(&model);
   return code;
}

/* Right slopes give the derivative of runs, and wrong ones are refused; S_qq alone is a choice, as the splitting is. */
static void check_units(const char *scheme, units u) {
   static double plain[FEW]; /* q at the end in units of one, which come first */
   const double right[2][2] = {{1, 1}, {1, 1}}, of_p[2][2] = {{1, 1}, {1, 1.01}}, of_both[2][2] = {{1, .99}, {.99, 1}};
   const double choice[2][2] = {{1.01, 1}, {1, 1}}, odd[2][2] = {{1, 1.01}, {1, 1}},
                no_number[2][2] = {{1, 1}, {1, NAN}};
   double above[FEW], below[FEW], worst = 0, size = 0, first;

   OK(gradient_by(scheme, u, right));
   run_spring(scheme, u, 1.3 + 1e-5, above);
   run_spring(scheme, u, 1.3 - 1e-5, below);
   for (int i = 0; i < FEW; i++) {
      const double slope = by_q[DOFS * FEW + i] / u.length * u.k;
      plain[i] = plain[i] != 0 ? plain[i] : value[i];
      CHECK(fabs(value[i] / u.length - plain[i]) < 1e-11);
      worst = fmax(worst, fabs(slope - (above[i] - below[i]) / 2e-5));
      size = fmax(size, fabs(slope));
   }
   CHECK(worst < 1e-8 * size && size > 1);
   first = by_q[DOFS * FEW];
   OK(gradient_by(scheme, u, choice));
   CHECK(fabs(by_q[DOFS * FEW] - first) > 1e-7 * fabs(first) && fabs(by_q[DOFS * FEW] - first) < 1e-3 * fabs(first));
   EXPECT(SYMSDE_FALSE_TRAIT, "wide|d2H/(dp_5 dp_5) changes with parameter 1 by ", gradient_by(scheme, u, of_p));
   EXPECT(SYMSDE_FALSE_TRAIT, "wide|d2H/(dp_5 dq_5) changes with parameter 1 by ", gradient_by(scheme, u, of_both));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "parameter 1 that is not symmetric", gradient_by(scheme, u, odd));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "parameter 1 with an entry (10,10) that is not finite",
          gradient_by(scheme, u, no_number));
}

/* Frequencies of a rotation say that no parameter changes velocities: k of this spring does. */
static void check_rotation(void) {
   double squares[DOFS], frequency[DOFS], right[2 * DOFS][2 * DOFS], q0[DOFS], p0[DOFS];
   spring own = {1, 0.9, 0, 0.2, 1};
   symsde_model model = NULL, spring = new_spring(&own, 0), wide = new_spring(&own, 1);
   symsde_scheme scheme = new_scheme("gauss_dkdkd_rotation");
   symsde_options options = few_steps((units){1, 1, 1, 1});
   symsde_input input = some_input(q0, p0);

   start_from(1, q0, p0);
   fill(&own, 1, right);
   for (int d = 0; d < DOFS; d++) {
      squares[d] = 0.9;
      frequency[d] = sqrt(0.9);
   }
   OK(symsde_model_with_user(spring, &own, frequency, &model, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "derivatives by these parameters are not known",
          symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &own.k, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   OK(symsde_model_set_flow_slopes(wide, DOFS, &right[0][0], squares, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "d2H/(dp_1 dp_1) changes with parameter 1 by 0, and its Hessian says by 1",
          symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &own.k, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   squares[2] = INFINITY;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "square of a frequency that is not finite",
          symsde_model_set_flow_slopes(wide, DOFS, NULL, squares, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "ndof = 6 of 6 positions",
          symsde_model_set_flow_slopes(wide, 6, &right[0][0], NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "ndof = 0", symsde_model_set_flow_slopes(wide, 0, &right[0][0], NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_set_flow_slopes(NULL, 5, &right[0][0], NULL, &error));
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&wide);
   symsde_model_delete(&spring);
   symsde_model_delete(&model);
}

int main(void) {
   const units all[] = {{1, 1, 1, 1}, {1e-9, 1e12, 1e-9, 1}, {1e12, 1e-9, 1e12, 1e-9}, {1e-9, 1e-9, 1e12, 1e12}};

   for (int i = 0; i < 4; i++) {
      check_units("gauss_dkdkd", all[i]);
   }
   check_rotation();
   return close_report();
}
