/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Prepared runs: the bits of symsde_simulate in however many calls, on a state that the host may change, with model and
 * scheme deleted, in a forked process too; refusals; runs that are stopped and resumed.
 */
#define _POSIX_C_SOURCE 200809L
#include "run.h"

#include <sys/wait.h>
#include <unistd.h>

static arrays whole, pieces;

static symsde_state state_of(symsde_run run) {
   symsde_state state;
   CHECK(symsde_state_init(&state) == 0);
   OK(symsde_run_state(run, &state, &error));
   return state;
}

/* the run outlives the model and the scheme that it is made of */
static symsde_run prepared(const symsde_options *options) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   const symsde_input input = some_input(&one, &zero);
   symsde_run run = NULL;

   OK(symsde_run_new(model, scheme, options, &input, &run, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return run;
}

static void run_whole(const symsde_options *options) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&whole, 1);

   OK(symsde_simulate(model, scheme, options, &input, &paths, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

static int is_last(symsde_run run) {
   const symsde_state state = state_of(run);
   return memcmp(state.q, whole.last_q, sizeof whole.last_q) == 0 &&
          memcmp(state.p, whole.last_p, sizeof whole.last_p) == 0;
}

/* one step, then several steps of which some are saved, then the remaining steps */
static void test_pieces(void) {
   symsde_options options = some_options();
   symsde_paths paths = paths_in(&pieces, 0);
   symsde_report report;

   run_whole(&options);
   for (int threads = 1; threads <= 2; threads++) {
      options.threads = threads;
      options.lanes = 8 * threads;
      symsde_run run = prepared(&options);
      for (int i = 0; i < SAVE; i++) {
         OK(symsde_run_advance(run, 1, 1, NULL, NULL, &error));
      }
      OK(symsde_run_advance(run, 2 * SAVE, SAVE, NULL, &paths, &error));
      CHECK(memcmp(pieces.q, whole.q + PATHS, 3 * PATHS * sizeof(double)) == 0);
      CHECK(memcmp(pieces.t, whole.t + 1, 3 * sizeof(double)) == 0);
      OK(symsde_run_advance(run, STEPS - 3 * SAVE, 1, NULL, NULL, &error));
      CHECK(is_last(run));
      const symsde_state state = state_of(run);
      CHECK(state.next_step == STEPS && state.paths == PATHS && state.ndof == 1 && state.nnoise == 1);
      CHECK(fabs(state.t - 6) < 1e-12 && state.q_low == NULL && state.status[0] == 0 && state.failed_step[0] == -1);
      symsde_report_init(&report);
      OK(symsde_run_report(run, &report, &error));
      CHECK(report.path_steps == STEPS * PATHS && report.threads == threads && report.status == 0);
      const symsde_input input = some_input(&one, &zero);
      OK(symsde_run_reset(run, &input, options.seed, 0, 0, &error));
      OK(symsde_run_advance(run, STEPS, STEPS, NULL, NULL, &error));
      CHECK(is_last(run) && state_of(run).q == state.q);
      OK(symsde_run_delete(&run));
      CHECK(run == NULL && symsde_run_delete(&run) == 0 && symsde_run_delete(NULL) == 0);
   }
}

/* a caller that changes states between steps and supplies its own increments */
static void test_host_loop(void) {
   symsde_options options = some_options();
   options.paths = 2;
   symsde_run run = prepared(&options);
   const symsde_state state = state_of(run);
   const double dw[2] = {0.1, -0.2};
   symsde_input input;

   symsde_input_init(&input);
   input.increments = dw;
   input.increment_rows = input.increment_noises = 1;
   input.increment_paths = 2;
   for (int i = 0; i < 3; i++) {
      state.q[0] = 1;
      state.p[0] = 0;
      OK(symsde_run_advance(run, 1, 1, &input, NULL, &error));
      const double angle = 2 * atan(0.5 * (options.step + 0.3 * dw[0])); /* angle of a midpoint step, [WHSB] sec. 5 */
      CHECK(fabs(state.q[0] - cos(angle)) < 1e-15 && fabs(state.p[0] + sin(angle)) < 1e-15);
   }
   const double turned = 6 * atan(0.5 * (options.step + 0.3 * dw[1]));
   CHECK(fabs(state.q[1] - cos(turned)) < 1e-14);
   state.q[1] = NAN;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "path 1|not finite", symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   symsde_run_delete(&run);
}

static int stop(int64_t done, int64_t total, void *user) {
   (void)done, (void)total, (void)user;
   return 1;
}

static void test_stopped(void) {
   symsde_options options = some_options();
   options.lanes = 8;
   options.threads = 1; /* one thread: with several, another one could have begun the last block before the stop */
   symsde_run run = prepared(&options);
   symsde_paths paths = paths_in(&pieces, 0);
   symsde_input input;

   run_whole(&options);
   EXPECT(SYMSDE_INCOMPATIBLE, "nothing to resume", symsde_run_resume(run, NULL, NULL, &error));
   symsde_input_init(&input);
   input.progress = stop;
   EXPECT(SYMSDE_STOPPED, "stopped", symsde_run_advance(run, STEPS, SAVE, &input, &paths, &error));
   CHECK(state_of(run).status[PATHS - 1] == SYMSDE_STOPPED && state_of(run).failed_step[PATHS - 1] == 0);
   EXPECT(SYMSDE_INCOMPATIBLE, "step 40|resume or reset", symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   EXPECT(SYMSDE_STOPPED, "stopped", symsde_run_resume(run, &input, &paths, &error));
   OK(symsde_run_resume(run, NULL, &paths, &error));
   CHECK(memcmp(pieces.q, whole.q, sizeof(double) * NTIME * PATHS) == 0);
   CHECK(is_last(run) && state_of(run).status[PATHS - 1] == 0);
   symsde_run_delete(&run);
}

/* a gradient that tries to advance the run that is calling it */
static symsde_run nested;
static int nested_status;

static int nesting_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                            double *hq, double *hp, void *user) {
   if (nested != NULL) {
      nested_status = symsde_run_advance(nested, 1, 1, NULL, NULL, NULL);
   }
   return pendulum_gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user);
}

static void test_refusals(void) {
   pendulum_user user = {0.3, 1e9, 0};
   symsde_traits traits;
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_run run = NULL;

   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = 1;
   OK(symsde_model_new("nesting", &traits, nesting_gradient, NULL, NULL, NULL, &user, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "run is NULL", symsde_run_new(model, scheme, &options, &input, NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_run_new(NULL, scheme, &options, &input, &run, &error));
   options.step = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "step = 0", symsde_run_new(model, scheme, &options, &input, &run, &error));
   options.step = 0.1;
   options.paths = (int64_t)1 << 40;
   EXPECT(SYMSDE_OUT_OF_MEMORY, "fewer paths", symsde_run_new(model, scheme, &options, &input, &run, &error));
   CHECK(run == NULL);
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_run_new", symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_run_new", symsde_run_report((symsde_run)scheme, NULL, &error));
   options.paths = 1;
   options.threads = 1;
   OK(symsde_run_new(model, scheme, &options, &input, &run, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "steps = -1", symsde_run_advance(run, -1, 1, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "save_every = 0", symsde_run_advance(run, 1, 0, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "state is NULL", symsde_run_state(run, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "report is NULL", symsde_run_report(run, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "first_step = -1", symsde_run_reset(run, &input, 1, 0, -1, &error));
   nested = run;
   OK(symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   CHECK(nested_status == SYMSDE_INCOMPATIBLE && state_of(run).next_step == 1);
   nested = NULL;
   user.refuse_after = 0; /* the callback fails; the path takes no further step until the run is reset */
   EXPECT(SYMSDE_CALLBACK_FAILED, "17", symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   user.refuse_after = 1e9;
   CHECK(state_of(run).status[0] > 0 && state_of(run).failed_step[0] == 1);
   EXPECT(SYMSDE_PATHS_FAILED, "1 path failed", symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   OK(symsde_run_reset(run, &input, 1, 0, 0, &error));
   OK(symsde_run_advance(run, 1, 1, NULL, NULL, &error));
   symsde_run_delete(&run);
}

/* one degree of freedom and two noises */
static void test_sizes(void) {
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("midpoint");
   const symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_run run = NULL;

   OK(symsde_model_get("synchrotron", 0, NULL, NULL, &model, &error));
   OK(symsde_run_new(model, scheme, &options, &input, &run, &error));
   CHECK(state_of(run).ndof == 1 && state_of(run).nnoise == 2);
   symsde_run_delete(&run);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* a run prepared for two threads goes on with one in a child process */
static void test_fork(void) {
   symsde_options options = some_options();
   int status = -1;

   options.threads = 2;
   options.lanes = 8;
   run_whole(&options);
   symsde_run run = prepared(&options);
   OK(symsde_run_advance(run, STEPS / 2, 1, NULL, NULL, &error));
   fflush(stdout);
   const pid_t forked = fork();
   if (forked == 0) {
      alarm(600); /* SIGALRM ends a child that hangs */
      OK(symsde_run_advance(run, STEPS / 2, 1, NULL, NULL, &error));
      CHECK(is_last(run));
      fflush(stdout);
      _exit(failed > 0);
   }
   CHECK(forked > 0 && waitpid(forked, &status, 0) == forked);
   CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
   OK(symsde_run_advance(run, STEPS / 2, 1, NULL, NULL, &error));
   CHECK(is_last(run));
   symsde_run_delete(&run);
}

/* saved times alone, and runs without an array for times: the same bits, also from a later first step */
static void test_times(void) {
   symsde_options options = some_options();
   symsde_paths paths = paths_in(&pieces, 1);
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   const symsde_input input = some_input(&one, &zero);
   double t[NTIME];

   options.first_step = 3;
   options.t0 = -0.7;
   run_whole(&options);
   OK(symsde_saved_times(&options, t, &error));
   CHECK(memcmp(t, whole.t, sizeof t) == 0 && t[0] == -0.7 + 3 * 0.1);
   paths.t = NULL;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(memcmp(pieces.q, whole.q, sizeof(double) * NTIME * PATHS) == 0);
   memset(&pieces, 0, sizeof pieces);
   symsde_run run = prepared(&options);
   OK(symsde_run_advance(run, STEPS, SAVE, NULL, &paths, &error));
   CHECK(memcmp(pieces.p, whole.p, sizeof(double) * NTIME * PATHS) == 0 && pieces.t[1] == 0);
   symsde_run_delete(&run);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

int main(void) {
   test_pieces();
   test_times();
   test_host_loop();
   test_stopped();
   test_refusals();
   test_sizes();
   test_fork();
   return close_report();
}
