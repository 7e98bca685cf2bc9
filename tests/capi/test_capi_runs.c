/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Runs through the C interface: paths, moments, increments, callbacks, outcomes, diagnostics.
 */
#define _POSIX_C_SOURCE 200112L /* setenv */
#include "run.h"

static arrays a;
static double dw[STEPS * PATHS];
static arrays b;

static void test_simulate(void) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 1), few = paths_in(&b, 0);
   symsde_report report;
   double worst = 0;

   symsde_report_init(&report);
   a.q_low[3] = 7;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   for (int i = 0; i < NTIME * PATHS; i++) {
      worst = fmax(worst, fabs(a.q[i] * a.q[i] + a.p[i] * a.p[i] - 1));
   }
   CHECK(worst < 1e-13 && a.q[0] == 1 && a.p[PATHS - 1] == 0 && a.q[PATHS] != a.q[PATHS + 1]);
   CHECK(a.t[0] == 2 && a.t[NTIME - 1] == 2 + 40 * 0.1);
   CHECK(a.status[0] == 0 && a.failed_step[PATHS - 1] == -1 && a.q_low[3] == 0);
   CHECK(memcmp(a.last_q, a.q + (NTIME - 1) * PATHS, sizeof a.last_q) == 0);
   CHECK(report.status == 0 && report.path_steps == STEPS * PATHS && report.normals == STEPS * PATHS);
   CHECK(report.correction == SYMSDE_CORRECTION_NONE && report.stepper[0] != 0 && report.left_out[0] != 0);
   CHECK(report.threads >= 1 && report.lanes == 256 && report.seconds_run > 0 && report.failed == 0);

   /* other threads, other blocks, no report, no last state, an older and smaller struct: the same bits */
   options.threads = 2;
   options.lanes = 8;
   few.struct_size = offsetof(symsde_paths, last_q);
   OK(symsde_simulate(model, scheme, &options, &input, &few, NULL, &error));
   CHECK(memcmp(a.q, b.q, sizeof(double) * NTIME * PATHS) == 0 && memcmp(a.p, b.p, sizeof(double) * PATHS) == 0);

   /* a run driven by its own increments repeats itself */
   OK(symsde_increments(model, NULL, &options, dw, &error));
   input.increments = dw;
   input.increment_rows = STEPS;
   input.increment_noises = 1;
   input.increment_paths = PATHS;
   OK(symsde_simulate(model, scheme, &options, &input, &few, &report, &error));
   CHECK(memcmp(a.q, b.q, sizeof(double) * NTIME * PATHS) == 0 && report.normals == 0);
   input.increment_rows = STEPS - 1;
   EXPECT(SYMSDE_WRONG_SHAPE, "39|40", symsde_simulate(model, scheme, &options, &input, &few, NULL, &error));
   input.increment_rows = -1;
   EXPECT(SYMSDE_WRONG_SHAPE, "increments|negative",
          symsde_simulate(model, scheme, &options, &input, &few, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

static void test_resume(void) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options(), first, rest;
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 1), parts = paths_in(&b, 1);
   static double odd[STEPS * PATHS];

   options.compensated = 1;
   options.save_every = 1;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(a.q_low[0] != 0 || a.q_low[1] != 0);
   first = rest = options;
   first.steps = 17; /* an odd first step is the second of a pair */
   rest.first_step = 17;
   rest.steps = STEPS - 17;
   OK(symsde_simulate(model, scheme, &first, &input, &parts, NULL, &error));
   static double q[PATHS], p[PATHS], q_low[PATHS], p_low[PATHS];
   memcpy(q, b.last_q, sizeof q);
   memcpy(p, b.last_p, sizeof p);
   memcpy(q_low, b.q_low, sizeof q);
   memcpy(p_low, b.p_low, sizeof p);
   input = some_input(q, p);
   input.q0_paths = input.p0_paths = PATHS;
   input.q0_low = q_low;
   input.p0_low = p_low;
   OK(symsde_simulate(model, scheme, &rest, &input, &parts, NULL, &error));
   CHECK(memcmp(a.q + 17 * PATHS, b.q, sizeof(double) * (STEPS - 16) * PATHS) == 0);
   CHECK(memcmp(a.p_low, b.p_low, sizeof a.p_low) == 0 && b.t[0] == a.t[17] && b.t[1] == a.t[18]);
   OK(symsde_increments(model, NULL, &options, dw, &error));
   OK(symsde_increments(model, NULL, &rest, odd, &error));
   CHECK(memcmp(dw + 17 * PATHS, odd, sizeof(double) * (STEPS - 17) * PATHS) == 0);
   /* low parts count in moments, too, as large ones show */
   static double t[STEPS + 1], mean[3 * (STEPS + 1)], variance[3 * (STEPS + 1)], se[3 * (STEPS + 1)];
   static int64_t n_ok[STEPS + 1];
   double sum = 0;
   symsde_moments *m = malloc(sizeof *m);
   symsde_moments_init(m);
   m->t = t;
   m->n_ok = n_ok;
   m->mean = mean;
   m->variance = variance;
   m->se_mean = se;
   for (int i = 0; i < PATHS; i++) {
      q_low[i] = 0.25;
      p_low[i] = 0;
   }
   OK(symsde_compute_moments(model, scheme, &rest, &input, m, NULL, &error));
   OK(symsde_simulate(model, scheme, &rest, &input, &parts, NULL, &error));
   for (int i = 0; i < PATHS; i++) {
      sum += b.last_q[i] / PATHS;
   }
   CHECK(n_ok[STEPS - 17] == PATHS && fabs(mean[3 * (STEPS - 17)] - sum) < 1e-14);
   free(m);
   /* every bit of the seed counts */
   rest = options;
   rest.seed = 5;
   OK(symsde_increments(model, NULL, &rest, odd, &error));
   CHECK(memcmp(odd, dw, sizeof dw) != 0);
   /* fewer paths, beginning with another first path */
   rest = options;
   rest.first_path = 290;
   rest.paths = 10;
   OK(symsde_increments(model, NULL, &rest, odd, &error));
   CHECK(odd[0] == dw[290] && odd[9] == dw[299] && odd[10 * (STEPS - 1)] == dw[PATHS * (STEPS - 1) + 290]);
   input.q0_paths = 7;
   EXPECT(SYMSDE_WRONG_SHAPE, "7|300", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

static int observe(int nlane, int ndof, double t, const double *q, const double *p, double *values, void *user) {
   (void)ndof;
   for (int i = 0; i < nlane; i++) {
      values[i] = q[i] * p[i];
      values[nlane + i] = t;
   }
   return user != NULL && t > *(const double *)user ? 23 : 0;
}

static void test_moments(void) {
   enum { NVALUE = 2 + 1 + 2 };
   static double t[NTIME], mean[NTIME * NVALUE], variance[NTIME * NVALUE], se[NTIME * NVALUE];
   static int64_t n_ok[NTIME];
   const double limit = 3;
   pendulum_user user = {0.3, INFINITY, 0.0};
   symsde_model model = new_pendulum(&user);
   symsde_scheme scheme = new_scheme("stormer_verlet");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;
   symsde_moments *m = malloc(sizeof *m);
   double sum = 0, squares = 0, energy = 0;

   symsde_report_init(&report);
   symsde_moments_init(m);
   m->t = t;
   m->n_ok = n_ok;
   m->mean = mean;
   m->variance = variance;
   m->se_mean = se;
   m->nobservable = 2;
   m->observables = observe;
   OK(symsde_compute_moments(model, scheme, &options, &input, m, &report, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   const double *q = a.q + (NTIME - 1) * PATHS, *p = a.p + (NTIME - 1) * PATHS, *last = mean + (NTIME - 1) * NVALUE;
   for (int i = 0; i < PATHS; i++) {
      sum += q[i] / PATHS;
      energy += (0.5 * p[i] * p[i] - cos(q[i])) / PATHS;
   }
   for (int i = 0; i < PATHS; i++) {
      squares += (q[i] - sum) * (q[i] - sum) / (PATHS - 1);
   }
   CHECK(fabs(last[0] - sum) < 1e-14 && fabs(last[2] - energy) < 1e-14 && last[4] == t[NTIME - 1]);
   CHECK(fabs(variance[(NTIME - 1) * NVALUE] - squares) < 1e-13 && n_ok[NTIME - 1] == PATHS && t[0] == 2);
   CHECK(fabs(se[(NTIME - 1) * NVALUE] - sqrt(squares / PATHS)) < 1e-13 && variance[4] == 0);
   CHECK(m->nfailed_listed == 0 && report.status == 0 && mean[0] == 1 && mean[3] == 0);

   m->observables_user = (void *)&limit;
   EXPECT(SYMSDE_CALLBACK_FAILED, "23", symsde_compute_moments(model, scheme, &options, &input, m, &report, &error));
   /* the failing observable ends the run early */
   CHECK(report.status == SYMSDE_CALLBACK_FAILED && report.path_steps < STEPS * PATHS);
   m->observables = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "observables is NULL",
          symsde_compute_moments(model, scheme, &options, &input, m, &report, &error));
   m->nobservable = -1;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nobservable = -1",
          symsde_compute_moments(model, scheme, &options, &input, m, &report, &error));
   m->nobservable = 0;
   m->se_mean = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "se_mean is NULL",
          symsde_compute_moments(model, scheme, &options, &input, m, &report, &error));
   m->se_mean = se;
   options.first_path = 100;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "256", symsde_compute_moments(model, scheme, &options, &input, m, NULL, &error));
   options = some_options();
   options.steps = (int64_t)1 << 44;
   options.save_every = 1;
   EXPECT(SYMSDE_OUT_OF_MEMORY, "save_every", symsde_compute_moments(model, scheme, &options, &input, m, NULL, &error));
   m->struct_size = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "symsde_moments_init first",
          symsde_compute_moments(model, scheme, &options, &input, m, NULL, &error));
   free(m);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* a force that is NaN for q < -1.2 */
static int cliff_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; i < nlane; i++) {
      if (hq != NULL) {
         hq[i] = w[i] * sqrt(q[i] + 1.2) + w[nlane + i];
      }
      if (hp != NULL) {
         hp[i] = w[i] * p[i];
      }
   }
   return 0;
}

static void test_failed_paths(void) {
   static double t[NTIME], mean[NTIME * 2], variance[NTIME * 2], se[NTIME * 2];
   static int64_t n_ok[NTIME];
   symsde_traits traits = pendulum_traits();
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("symplectic_euler");
   symsde_options options = some_options();
   symsde_input input = some_input(&zero, &zero);
   symsde_paths paths = paths_in(&a, 1);
   symsde_report report;
   symsde_moments *m = malloc(sizeof *m);
   int64_t nfailed = 0, first_failed = -1;

   traits.additive = 1;
   OK(symsde_model_new("cliff", &traits, cliff_gradient, NULL, NULL, NULL, NULL, &model, &error));
   symsde_report_init(&report);
   EXPECT(SYMSDE_PATHS_FAILED, "paths failed|smaller step",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   for (int i = 0; i < PATHS; i++) {
      if (a.status[i] != 0) {
         nfailed++;
         first_failed = first_failed < 0 ? i : first_failed;
      }
   }
   CHECK(nfailed > 0 && nfailed < PATHS && report.failed == nfailed && report.status == SYMSDE_PATHS_FAILED);
   CHECK(a.status[first_failed] == SYMSDE_NONFINITE && a.failed_step[first_failed] >= 0);
   CHECK(isnan(a.q[(NTIME - 1) * PATHS + first_failed]) && isfinite(a.last_q[first_failed]));

   symsde_moments_init(m);
   m->t = t;
   m->n_ok = n_ok;
   m->mean = mean;
   m->variance = variance;
   m->se_mean = se;
   EXPECT(SYMSDE_PATHS_FAILED, "paths failed",
          symsde_compute_moments(model, scheme, &options, &input, m, &report, &error));
   CHECK(m->nfailed_listed == nfailed && m->failed[0] == first_failed && n_ok[NTIME - 1] == PATHS - nfailed);
   CHECK(m->failed_status[0] == SYMSDE_NONFINITE && m->failed_step[0] == a.failed_step[first_failed]);
   CHECK(n_ok[0] == PATHS && isfinite(mean[(NTIME - 1) * 2]));
   free(m);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

#ifdef __linux__
/* user: number of calls, and the OR of all addresses passed with full blocks */
static int address_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                            double *hq, double *hp, void *user) {
   uintptr_t *seen = user;
   if (nlane == 256) {
      seen[0]++;
      seen[1] |= (uintptr_t)w | (uintptr_t)q | (uintptr_t)p | (uintptr_t)hq | (uintptr_t)hp;
   }
   return cliff_gradient(nlane, ndof, nham, t, w, q, p, hq, hp, NULL);
}

/* the columns of a block are aligned for vector registers and cache lines */
static void test_alignment(void) {
   symsde_traits traits = pendulum_traits();
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("symplectic_euler");
   symsde_options options = some_options();
   symsde_input input = some_input(&zero, &zero);
   symsde_paths paths = paths_in(&a, 1);
   uintptr_t seen[2] = {0, 0};

   traits.additive = 1;
   OK(symsde_model_new("addresses", &traits, address_gradient, NULL, NULL, NULL, seen, &model, &error));
   EXPECT(SYMSDE_PATHS_FAILED, "paths failed", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(seen[0] > 0 && seen[1] % 64 == 0);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}
#endif

typedef struct progress_user {
   int calls, stop;
   int64_t done, total;
} progress_user;

static int on_progress(int64_t done, int64_t total, void *user) {
   progress_user *u = user;
   u->calls++;
   u->done = done;
   u->total = total;
   return u->stop;
}

static void test_stop_and_refusing_callback(void) {
   pendulum_user user = {0.3, INFINITY, 0.0};
   symsde_model model = new_pendulum(&user);
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 1);
   symsde_report report;
   progress_user progress = {0, 0, 0, 0};

   symsde_report_init(&report);
   /* otherwise another thread may do all blocks, and the caller's thread alone asks for progress */
   options.threads = 1;
   input.progress = on_progress;
   input.progress_user = &progress;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(progress.calls >= 1 && progress.total == STEPS * PATHS && progress.done > 0);
   progress.stop = 1;
   EXPECT(SYMSDE_STOPPED, "stopped on request|300",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(report.status == SYMSDE_STOPPED && report.stopped == PATHS && a.status[PATHS - 1] == SYMSDE_STOPPED);
   CHECK(isnan(a.q[(NTIME - 1) * PATHS]) && isfinite(a.last_q[0]) && a.q[0] == 1);

   input.progress = NULL;
   user.refuse_after = 3;
   EXPECT(SYMSDE_CALLBACK_FAILED, "17", symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(report.status == SYMSDE_CALLBACK_FAILED && isnan(a.q[(NTIME - 1) * PATHS]) && a.q[0] == 1);
   user.refuse_after = INFINITY;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error)); /* the model must be probed again */
   user.wrong = 1;
   EXPECT(SYMSDE_FALSE_TRAIT, "own pendulum",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

static void test_diagnostics(void) {
   static double defect[PATHS], action[STEPS * PATHS], residual[4 * PATHS], q[(STEPS + 1) * PATHS];
   static double p[(STEPS + 1) * PATHS];
   symsde_model model = new_kubo(), pendulum = NULL;
   symsde_scheme midpoint = new_scheme("midpoint"), heun = new_scheme("heun");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   double worst = 0, largest = 0;

   options.save_every = 1;
   OK(symsde_simulate(model, midpoint, &options, &input, &paths, NULL, &error));
   OK(symsde_increments(model, NULL, &options, dw, &error));
   OK(symsde_symplecticity(model, midpoint, &options, PATHS, a.q, a.p, dw, defect, &error));
   for (int i = 0; i < PATHS; i++) {
      worst = fmax(worst, defect[i]);
   }
   CHECK(worst < 1e-12);
   OK(symsde_symplecticity(model, heun, &options, PATHS, a.q, a.p, dw, defect, &error));
   CHECK(defect[0] > 1e-12 && defect[PATHS - 1] > 1e-12);

   OK(symsde_discrete_action(model, midpoint, &options, a.q, a.p, dw, action, &error));
   worst = 0;
   for (int i = 0; i < STEPS * PATHS; i++) {
      const double qm = 0.5 * (a.q[i] + a.q[i + PATHS]), pm = 0.5 * (a.p[i] + a.p[i + PATHS]);
      const double own = pm * (a.q[i + PATHS] - a.q[i]) - (0.1 + 0.3 * dw[i]) * 0.5 * (qm * qm + pm * pm);
      worst = fmax(worst, fabs(action[i] - own));
   }
   CHECK(worst < 1e-13);
   OK(symsde_euler_lagrange_residual(model, midpoint, &options, a.q, a.p, dw, residual, &error));
   for (int i = 0; i < 4 * PATHS; i++) {
      largest = fmax(largest, residual[i]);
   }
   CHECK(largest < 1e-12);

   /* a diagnosis calls the progress function of its options, which can stop it */
   progress_user progress = {0, 1, -1, -1};
   options.progress = on_progress;
   options.progress_user = &progress;
   EXPECT(SYMSDE_STOPPED, "stopped on request",
          symsde_symplecticity(model, midpoint, &options, PATHS, a.q, a.p, dw, defect, &error));
   EXPECT(SYMSDE_STOPPED, "stopped on request",
          symsde_discrete_action(model, midpoint, &options, a.q, a.p, dw, action, &error));
   EXPECT(SYMSDE_STOPPED, "stopped on request",
          symsde_euler_lagrange_residual(model, midpoint, &options, a.q, a.p, dw, residual, &error));
   CHECK(progress.calls == 3 && progress.done == 0 && progress.total > 0);
   progress.stop = 0;
   OK(symsde_euler_lagrange_residual(model, midpoint, &options, a.q, a.p, dw, residual, &error));
   CHECK(progress.calls >= 4);
   options.progress = NULL;

   /* exact: kubo rotates by a t + sigma W */
   OK(symsde_exact_solution(model, midpoint, &options, &input, q, p, &error));
   double w = 0;
   worst = 0;
   for (int n = 0; n < STEPS; n++) {
      w += dw[n * PATHS + 5];
      worst = fmax(worst, fabs(q[(n + 1) * PATHS + 5] - cos(0.1 * (n + 1) + 0.3 * w)));
      worst = fmax(worst, fabs(p[(n + 1) * PATHS + 5] + sin(0.1 * (n + 1) + 0.3 * w)));
   }
   CHECK(worst < 1e-13);

   OK(symsde_model_get("pendulum", 0, NULL, NULL, &pendulum, &error));
   CHECK(symsde_exact_solution(pendulum, midpoint, &options, &input, q, p, &error) < 0 && error.message[0] != 0);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "defect is NULL",
          symsde_symplecticity(model, midpoint, &options, PATHS, a.q, a.p, dw, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "npoint = 0",
          symsde_symplecticity(model, midpoint, &options, 0, a.q, a.p, dw, defect, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "dw is NULL",
          symsde_discrete_action(model, midpoint, &options, a.q, a.p, NULL, action, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "scheme",
          symsde_euler_lagrange_residual(model, NULL, &options, a.q, a.p, dw, residual, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "p is NULL",
          symsde_exact_solution(model, midpoint, &options, &input, q, NULL, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&pendulum);
   symsde_scheme_delete(&midpoint);
   symsde_scheme_delete(&heun);
}

/* Threads of a run: options.threads, else SYMSDE_NUM_THREADS, but never more than the run has blocks. */
static void test_threads(void) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;

   options.lanes = 128; /* three blocks */
   symsde_report_init(&report);
   for (int threads = options.threads = 1; threads <= 4; options.threads = ++threads) {
      OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
      CHECK(report.threads == (threads < 3 ? threads : 3));
   }
   setenv("SYMSDE_NUM_THREADS", "2", 1);
   options.threads = 0;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(report.threads == 2);
   unsetenv("SYMSDE_NUM_THREADS");
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* Steps so long that the solver does not converge from zero increments: the counters in the report add up. With many
 * iterations damping rescues paths, with few continuation does. */
static void test_counters_of_hard_steps(void) {
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   symsde_input input = some_input(NULL, NULL);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report many, few;
   static double q[PATHS], p[PATHS];
   int64_t failed = 0;

   for (int i = 0; i < PATHS; i++) {
      q[i] = 3 * sin(0.37 * i);
      p[i] = 2 * cos(1.1 * i);
   }
   input.q0 = q;
   input.p0 = p;
   input.q0_paths = input.p0_paths = PATHS;
   OK(symsde_model_get("synchrotron", 0, NULL, NULL, &model, &error));
   options.step = 1.5;
   options.steps = options.save_every = 1;
   symsde_report_init(&many);
   symsde_report_init(&few);
   symsde_simulate(model, scheme, &options, &input, &paths, &many, &error);
   CHECK(many.failures > 0 && many.damped > 0 && many.damped != many.continued);
   CHECK(many.failures == many.damped + many.continued + many.failed);
   options.max_iter = 6;
   symsde_simulate(model, scheme, &options, &input, &paths, &few, &error);
   for (int i = 0; i < PATHS; i++) {
      failed += a.status[i] != 0;
   }
   CHECK(few.continued > many.continued && few.damped != few.continued && few.failed == failed && few.stopped == 0);
   CHECK(few.failures == few.damped + few.continued + failed);
   CHECK(few.path_steps == PATHS - failed && few.gradients > 0 && few.iterations > PATHS && few.solves > PATHS);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* drawn states: rows of the factor, any part of the paths, and refusals */
static void test_draw_states(void) {
   enum { N = 300, PART = 40 };
   static double q[2][N], p[2][N], z[2][N], y[2][N], part[2][PART], of_p[2][PART];
   const double centre[4] = {1, 2, 3, 4}, one[4] = {1, 1, 1, 1}, zero[4] = {0, 0, 0, 0};
   const double factor[16] = {2, 0, 0, 0, 0, 1, 0, 0, 0.5, 0, 3, 0, 0, 0, 0, 1}; /* p_1 = 3 + q_1's z/2 + 3 z */
   const uint64_t seed = 0x8000000000000005u;

   OK(symsde_draw_states(SYMSDE_NORMAL_STATES, seed, 0, 256, N, 2, 1, zero, one, z[0], y[0], &error));
   OK(symsde_draw_states(SYMSDE_NORMAL_STATES, seed, 0, 256, N, 2, 4, centre, factor, q[0], p[0], &error));
   for (int i = 0; i < N; i++) {
      CHECK(fabs(q[0][i] - (1 + 2 * z[0][i])) < 1e-14 && fabs(q[1][i] - (2 + z[1][i])) < 1e-14);
      CHECK(fabs(p[0][i] - (3 + 0.5 * z[0][i] + 3 * y[0][i])) < 1e-13 && fabs(p[1][i] - (4 + y[1][i])) < 1e-14);
   }
   OK(symsde_draw_states(SYMSDE_NORMAL_STATES, seed, 0, 300, PART, 2, 4, centre, factor, part[0], of_p[0], &error));
   CHECK(memcmp(part[1], &q[1][44], sizeof part[1]) == 0 && memcmp(of_p[0], &p[0][44], sizeof of_p[0]) == 0);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "law = 3", symsde_draw_states(3, 1, 0, 0, N, 2, 1, zero, one, q[0], p[0], &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "columns = 2",
          symsde_draw_states(SYMSDE_UNIFORM_STATES, 1, 0, 0, N, 2, 2, zero, one, q[0], p[0], &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "negative",
          symsde_draw_states(SYMSDE_UNIFORM_STATES, 1, 0, 0, -1, 2, 1, zero, one, q[0], p[0], &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "p is NULL",
          symsde_draw_states(SYMSDE_UNIFORM_STATES, 1, 0, 0, N, 2, 1, zero, one, q[0], NULL, &error));
}

int main(void) {
   test_draw_states();
   test_simulate();
   test_resume();
   test_moments();
   test_failed_paths();
   test_counters_of_hard_steps();
   test_threads();
#ifdef __linux__
   test_alignment();
#endif
   test_stop_and_refusing_callback();
   test_diagnostics();
   return close_report();
}
