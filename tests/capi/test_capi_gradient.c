/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Gradients of a function of the path: by the initial state against the rotation that Kubo's oscillator is, by a
 * parameter against differences of runs; tangent vectors against both.
 */
#include "run.h"

static arrays a, b;
static double value[PATHS], by_q[2 * PATHS], by_p[PATHS];
static int32_t status[PATHS];
static int64_t failed_step[PATHS];

/* f = q at the end */
static int last_q(int64_t first, int lanes, int ndof, int ntime, int nparameter, const double *t, const double *q,
                  const double *p, double *f, double *fq, double *fp, double *fparameter, void *user) {
   int at = (ntime - 1) * ndof * lanes;

   (void)first, (void)nparameter, (void)t, (void)p, (void)fp, (void)fparameter;
   if (user != NULL) {
      return *(int *)user;
   }
   for (int i = 0; i < lanes; i++) {
      f[i] = q[at + i];
      fq[at + i] = 1;
   }
   return 0;
}

/* Kubo's oscillator with sigma as second position: S = (w_0 + sigma w_1) (q^2 + p^2)/2 */
static int gradient(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *hq,
                    double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; i < n; i++) {
      double rate = w[i] + q[n + i] * w[n + i];
      if (hq != NULL) {
         hq[i] = rate * q[i];
         hq[n + i] = w[n + i] * (q[i] * q[i] + p[i] * p[i]) / 2;
      }
      if (hp != NULL) {
         hp[i] = rate * p[i];
         hp[n + i] = 0;
      }
   }
   return 0;
}

static int hessian_vector(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          const double *vq, const double *vp, double *uq, double *up, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; i < n; i++) {
      double rate = w[i] + q[n + i] * w[n + i];
      uq[i] = rate * vq[i] + w[n + i] * q[i] * vq[n + i];
      up[i] = rate * vp[i] + w[n + i] * p[i] * vq[n + i];
      uq[n + i] = w[n + i] * (q[i] * vq[i] + p[i] * vp[i]);
      up[n + i] = 0;
   }
   return 0;
}

/* the linear oscillator with sigma as second position: S = w_0 (q^2 + p^2)/2 - sigma w_1 q */
static int linear_gradient(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                           double *hq, double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; i < n; i++) {
      if (hq != NULL) {
         hq[i] = w[i] * q[i] - q[n + i] * w[n + i];
         hq[n + i] = -w[n + i] * q[i];
      }
      if (hp != NULL) {
         hp[i] = w[i] * p[i];
         hp[n + i] = 0;
      }
   }
   return 0;
}

static int linear_product(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          const double *vq, const double *vp, double *uq, double *up, void *user) {
   (void)ndof, (void)nham, (void)t, (void)q, (void)p, (void)user;
   for (int i = 0; i < n; i++) {
      uq[i] = w[i] * vq[i] - w[n + i] * vq[n + i];
      uq[n + i] = -w[n + i] * vq[i];
      up[i] = w[i] * vp[i];
      up[n + i] = 0;
   }
   return 0;
}

/* covectors over several steps; the user pointer is a factor of the noise, 1 if it is right */
static int linear_pull(int n, int ndof, int nham, int nmoving, int nstep, double t, double h, const double *part,
                       const double *dw, const double *q, const double *theta, double *u, double *c, void *user) {
   const double factor = *(double *)user;

   CHECK(ndof == 2 && nham == 2 && nmoving == 1);
   (void)t, (void)q, (void)theta;
   for (int s = nstep; s >= 0; s--) {
      for (int i = 0; i < n; i++) {
         const double a = s > 0 ? part[1] : 0, b = s < nstep ? part[0] : 0;
         const double noise = (s > 0 ? a * dw[(s - 1) * n + i] : 0) + (s < nstep ? b * dw[s * n + i] : 0);
         u[i] -= (a + b) * h * c[i];
         u[n + i] += factor * noise * c[i];
         c[i] += s > 0 ? h * u[i] : 0;
      }
   }
   return 0;
}

static int faulty_product(int n, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          const double *vq, const double *vp, double *uq, double *up, void *user) {
   const int code = linear_product(n, ndof, nham, t, w, q, p, vq, vp, uq, up, user);

   for (int i = 0; i < n; i++) {
      uq[n + i] *= 1.01;
   }
   return code;
}

/* A wide model with a wrong Hessian is refused, and one that is another model at these parameters. */
static void check_wide(symsde_model model, symsde_scheme scheme, symsde_traits traits, symsde_model right,
                       double sigma) {
   const symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   const double other = 1.01 * sigma;
   const char *key = "sigma";
   symsde_model wide = NULL, by_path = NULL;

   OK(symsde_model_new("wide", &traits, linear_gradient, NULL, NULL, faulty_product, NULL, &wide, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "wide|hessian_vector",
          symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &sigma, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "dH_1/dq_1 of model 'wide' is -0.303|'linear_oscillator' is -0.3",
          symsde_path_gradient(model, right, scheme, &options, &input, 1, 1, &other, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   for (int i = 0; i < PATHS; i++) {
      value[i] = 0.3 + 0.001 * i;
   }
   OK(symsde_model_get_by_path("pendulum", 1, &key, PATHS, value, &by_path, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "differ from path to path",
          symsde_path_gradient(by_path, by_path, scheme, &options, &input, 0, 1, NULL, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   symsde_model_delete(&by_path);
   symsde_model_delete(&wide);
}

/* Gradients with a pull are those without it; a wrong one is refused. */
static void check_pull(void) {
   static double with_pull[2 * PATHS], other_p[PATHS];
   symsde_model model = NULL, wide = NULL;
   symsde_scheme scheme = new_scheme("stormer_verlet");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_traits traits;
   const char *key = "sigma";
   double sigma = 0.3, factor = 1, worst = 0;

   OK(symsde_model_get("linear_oscillator", 1, &key, &sigma, &model, &error));
   symsde_traits_init(&traits);
   traits.ndof = 2;
   traits.nnoise = 1;
   traits.has_hessian_vector = traits.separable = traits.position_noise = 1;
   OK(symsde_model_new("wide", &traits, linear_gradient, NULL, NULL, linear_product, &factor, &wide, &error));
   OK(symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &sigma, last_q, NULL, value, by_q, by_p, status,
                           failed_step, NULL, &error));
   check_wide(model, scheme, traits, wide, sigma);
   OK(symsde_model_set_pull(wide, linear_pull, &error));
   OK(symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &sigma, last_q, NULL, value, with_pull, other_p,
                           status, failed_step, NULL, &error));
   for (int i = 0; i < PATHS; i++) {
      worst = fmax(worst, fabs(with_pull[i] - by_q[i]) + fabs(with_pull[PATHS + i] - by_q[PATHS + i]));
      worst = fmax(worst, fabs(other_p[i] - by_p[i]));
   }
   CHECK(worst < 1e-11 && fabs(by_q[PATHS]) > 1e-3);
   factor = 1.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "wide|covectors over two steps",
          symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &sigma, last_q, NULL, value, with_pull,
                               other_p, status, failed_step, NULL, &error));
   OK(symsde_model_set_pull(wide, NULL, &error));
   OK(symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &sigma, last_q, NULL, value, with_pull, other_p,
                           status, failed_step, NULL, &error));
   CHECK(with_pull[PATHS] == by_q[PATHS]);
   EXPECT(SYMSDE_INCOMPATIBLE, "linear_oscillator|symsde_model_new", symsde_model_set_pull(model, linear_pull, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_set_pull(NULL, linear_pull, &error));
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&wide);
   symsde_model_delete(&model);
}

/* q at the end for one sigma */
static void run_with(double sigma, arrays *to) {
   const char *key = "sigma";
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("gauss2");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(to, 1);

   OK(symsde_model_get("kubo", 1, &key, &sigma, &model, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

int main(void) {
   symsde_model model = new_kubo(), wide = NULL;
   symsde_scheme scheme = new_scheme("gauss2"), kicks = new_scheme("euler_maruyama"), decays = new_scheme("gjf");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_traits traits;
   symsde_report report;
   double sigma = 0.3, worst = 0, size = 0;
   int code = 17;

   symsde_report_init(&report);
   symsde_traits_init(&traits);
   traits.ndof = 2;
   traits.nnoise = 1;
   traits.has_hessian_vector = 1;
   OK(symsde_model_new("wide", &traits, gradient, NULL, NULL, hessian_vector, NULL, &wide, &error));
   OK(symsde_path_gradient(model, wide, scheme, &options, &input, 1, 1, &sigma, last_q, NULL, value, by_q, by_p, status,
                           failed_step, &report, &error));
   run_with(sigma, &a);
   for (int i = 0; i < PATHS; i++) {
      worst = fmax(worst, fabs(by_q[i] - a.last_q[i]) + fabs(by_p[i] + a.last_p[i]));
      CHECK(value[i] == a.last_q[i] && status[i] == 0 && failed_step[i] == -1);
   }
   CHECK(worst < 1e-12 && report.status == 0 && report.path_steps == STEPS * PATHS);
   worst = 0;
   run_with(sigma + 1e-5, &a);
   run_with(sigma - 1e-5, &b);
   for (int i = 0; i < PATHS; i++) {
      worst = fmax(worst, fabs(by_q[PATHS + i] - (a.last_q[i] - b.last_q[i]) / 2e-5));
      size = fmax(size, fabs(by_q[PATHS + i]));
   }
   CHECK(worst < 1e-8 * size && size > 1);

   /* without parameters the wide model is the model itself */
   OK(symsde_path_gradient(model, model, scheme, &options, &input, 0, 1, NULL, last_q, NULL, value, by_q, by_p, status,
                           failed_step, NULL, &error));
   CHECK(fabs(by_q[0] - value[0]) < 1e-12);
   EXPECT(SYMSDE_CALLBACK_FAILED, "17",
          symsde_path_gradient(model, model, scheme, &options, &input, 0, 1, NULL, last_q, &code, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "Ito form",
          symsde_path_gradient(model, model, kicks, &options, &input, 0, 1, NULL, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "parameters for 2 paths",
          symsde_path_gradient(model, wide, scheme, &options, &input, 1, 2, value, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "2 parameters", /* a single one would be the rate of damping */
          symsde_path_gradient(model, model, scheme, &options, &input, 2, 1, value, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nparameter = -1",
          symsde_path_gradient(model, model, scheme, &options, &input, -1, 1, NULL, last_q, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "by_p is NULL",
          symsde_path_gradient(model, model, scheme, &options, &input, 0, 1, NULL, last_q, NULL, value, by_q, NULL,
                               status, failed_step, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "f is NULL",
          symsde_path_gradient(model, model, scheme, &options, &input, 0, 1, NULL, NULL, NULL, value, by_q, by_p,
                               status, failed_step, NULL, &error));

   /* tangent vectors: the columns of the rotation, and the derivative by sigma */
   static double v[3][2][PATHS], logs[3][PATHS], q_end[PATHS], p_end[PATHS];
   for (int i = 0; i < PATHS; i++) {
      v[0][0][i] = v[1][1][i] = 1;
   }
   OK(symsde_path_tangent(model, wide, scheme, &options, &input, 1, 1, &sigma, 3, 0, &v[0][0][0], &logs[0][0], q_end,
                          p_end, status, failed_step, &report, &error));
   run_with(sigma, &a);
   worst = 0;
   for (int i = 0; i < PATHS; i++) {
      worst = fmax(worst, fabs(v[0][0][i] - a.last_q[i]) + fabs(v[1][0][i] + a.last_p[i]));
      worst = fmax(worst, fabs(v[0][1][i] - a.last_p[i]) + fabs(v[1][1][i] - a.last_q[i]));
      worst = fmax(worst, fabs(v[2][0][i] - by_q[PATHS + i]) / size);
      CHECK(q_end[i] == a.last_q[i] && p_end[i] == a.last_p[i]);
   }
   CHECK(worst < 1e-12);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nvector = 0",
          symsde_path_tangent(model, wide, scheme, &options, &input, 1, 1, &sigma, 0, 0, &v[0][0][0], &logs[0][0],
                              q_end, p_end, status, failed_step, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "turn = -1",
          symsde_path_tangent(model, model, scheme, &options, &input, 0, 1, NULL, 2, -1, &v[0][0][0], &logs[0][0],
                              q_end, p_end, status, failed_step, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "logs is NULL",
          symsde_path_tangent(model, model, scheme, &options, &input, 0, 1, NULL, 2, 1, &v[0][0][0], NULL, q_end, p_end,
                              status, failed_step, NULL, &error));

   /* decays by rational functions, and noise of damping by three functionals */
   const double rate = 0.5;
   symsde_model pendulum = NULL;
   OK(symsde_model_get("driven_pendulum", 0, NULL, NULL, &pendulum, &error));
   OK(symsde_path_gradient(pendulum, pendulum, decays, &options, &input, 0, 1, NULL, last_q, NULL, value, by_q, by_p,
                           status, failed_step, NULL, &error));
   OK(symsde_model_set_damping(pendulum, 1, &rate, 0, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "rational functions",
          symsde_path_gradient(pendulum, pendulum, decays, &options, &input, 0, 1, NULL, last_q, NULL, value, by_q,
                               by_p, status, failed_step, NULL, &error));
   symsde_scheme_delete(&decays);
   decays = new_scheme("gauss_dkdkd");
   options.damping_noise = SYMSDE_DAMPING_NOISE_LAW3;
   EXPECT(SYMSDE_INCOMPATIBLE, "damping_noise \"law\", \"law2\"",
          symsde_path_tangent(pendulum, pendulum, decays, &options, &input, 0, 1, NULL, 2, 0, &v[0][0][0], &logs[0][0],
                              q_end, p_end, status, failed_step, NULL, &error));
   symsde_model_delete(&pendulum);
   symsde_scheme_delete(&decays);
   symsde_scheme_delete(&kicks);
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&wide);
   symsde_model_delete(&model);
   check_pull();
   return close_report();
}
