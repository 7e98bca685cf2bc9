/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Eight threads of the host in the library at once: own and shared models, callbacks, runs that are refused and runs
 * that fail. Every thread must see its own results to the bit and its own sentences to the letter, whatever the others
 * do. The sanitizers run this program too: a race that happens to do no harm is found by them.
 */
#define _POSIX_C_SOURCE 200809L
#include "run.h"

#include <pthread.h>

enum { THREADS = 8, ROUNDS = 12, TEXT = 4096 };

/* all threads use these handles, and none changes them meanwhile */
static symsde_model shared_kubo, shared_pendulum;
static symsde_scheme shared_midpoint;
static pendulum_user shared_user = {0.3, 100, 0};
static arrays kubo_alone, pendulum_alone;
static char certificate_alone[TEXT], build_alone[TEXT];

typedef struct worker {
   pthread_t thread;
   int id, passed, failed;
   arrays mine;
   char text[TEXT], name[64];
   pendulum_user user;
} worker;

static worker workers[THREADS];
static pthread_barrier_t barrier;

static symsde_options thread_options(void) {
   symsde_options options = some_options();
   options.threads = 1; /* the thread sanitizer does not see the locks of OpenMP */
   options.t0 = 0;
   return options;
}

static int same(const arrays *x, const arrays *y) {
   return memcmp(x->q, y->q, sizeof(double) * NTIME * PATHS) == 0 &&
          memcmp(x->p, y->p, sizeof(double) * NTIME * PATHS) == 0;
}

static void run_into(arrays *into, symsde_model model) {
   const symsde_options options = thread_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(into, 0);
   symsde_report report;

   symsde_report_init(&report);
   OK(symsde_simulate(model, shared_midpoint, &options, &input, &paths, &report, &error));
   CHECK(report.failed == 0 && report.threads == 1);
}

static void use_shared_models(worker *me) {
   run_into(&me->mine, shared_kubo);
   CHECK(same(&me->mine, &kubo_alone));
   run_into(&me->mine, shared_pendulum);
   CHECK(same(&me->mine, &pendulum_alone));
}

static void use_own_model(worker *me) {
   symsde_model model = new_pendulum(&me->user);
   symsde_traits traits;

   run_into(&me->mine, model);
   CHECK(same(&me->mine, &pendulum_alone));
   OK(symsde_model_probe(model, 0, &one, &zero, &error));
   symsde_traits_init(&traits);
   OK(symsde_model_traits(model, &traits, &error));
   CHECK(traits.nnoise == 1 && traits.has_hessian == 1);
   symsde_model_delete(&model);
}

/* refusals whose messages hold numbers of this thread alone */
static void be_refused(worker *me) {
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&me->mine, 0);
   symsde_options options = thread_options();
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   char wanted[TEXT];

   options.steps = 1000 + 10 * me->id + 1;
   options.save_every = 10;
   snprintf(wanted, sizeof wanted, "steps = %d is not a multiple of save_every = 10:", (int)options.steps);
   EXPECT(SYMSDE_INVALID_ARGUMENT, wanted,
          symsde_simulate(shared_kubo, shared_midpoint, &options, &input, &paths, NULL, &error));
   snprintf(me->name, sizeof me->name, "%.*s%d", 1 + 2 * me->id, "nonsense_nonsense", me->id);
   snprintf(wanted, sizeof wanted, "there is no model '%s'; the nearest is ", me->name);
   EXPECT(SYMSDE_UNKNOWN_NAME, wanted, symsde_model_get(me->name, 0, NULL, NULL, &model, &error));
   snprintf(wanted, sizeof wanted, "there is no scheme '%s'; the nearest is ", me->name);
   EXPECT(SYMSDE_UNKNOWN_NAME, wanted, symsde_scheme_get(me->name, &scheme, &error));
}

/* a shared model whose callback refuses the times of this thread alone: no other thread may get the error */
static void fail_in_a_callback(worker *me) {
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&me->mine, 0);
   symsde_options options = thread_options();

   options.t0 = shared_user.refuse_after - 1.05;
   EXPECT(SYMSDE_CALLBACK_FAILED, "a callback returned 17 and the run was aborted",
          symsde_simulate(shared_pendulum, shared_midpoint, &options, &input, &paths, NULL, &error));
   CHECK(isnan(me->mine.q[(NTIME - 1) * PATHS]));
   double gradients[2];
   int32_t commute[2];
   EXPECT(SYMSDE_CALLBACK_FAILED, "a callback returned 17",
          symsde_commutator(shared_pendulum, 101, 1, &one, &zero, gradients, commute, NULL, 0, NULL, NULL, &error));
}

/* every path fails, since momenta overflow */
static void fail_in_every_path(worker *me) {
   static const double fast = 1e308;
   const symsde_input input = some_input(&one, &fast);
   symsde_paths paths = paths_in(&me->mine, 0);
   symsde_options options = thread_options();
   symsde_report report;
   char wanted[TEXT];

   symsde_report_init(&report);
   options.paths = 100 + me->id;
   options.step = 10;
   snprintf(wanted, sizeof wanted, "%d paths failed, their values are NaN from there on", (int)options.paths);
   EXPECT(SYMSDE_PATHS_FAILED, wanted,
          symsde_simulate(shared_pendulum, shared_midpoint, &options, &input, &paths, &report, &error));
   CHECK(report.failed == options.paths && strstr(report.warnings, "h*omega = ") != NULL);
}

static int squares(int nlane, int ndof, double t, const double *q, const double *p, double *values, void *user) {
   (void)t;
   (void)p;
   for (int i = 0; i < nlane * ndof; i++) {
      values[i] = q[i] * q[i];
   }
   return *(const int *)user;
}

static void compute_moments(worker *me) {
   const symsde_input input = some_input(&one, &zero);
   symsde_options options = thread_options();
   symsde_moments *moments = malloc(sizeof *moments);
   double t[NTIME], mean[NTIME * 4], variance[NTIME * 4], se[NTIME * 4];
   int64_t n_ok[NTIME];
   int code = 0;

   symsde_moments_init(moments);
   moments->t = t;
   moments->n_ok = n_ok;
   moments->mean = mean;
   moments->variance = variance;
   moments->se_mean = se;
   moments->nobservable = 1;
   moments->observables = squares;
   moments->observables_user = &code;
   OK(symsde_compute_moments(shared_kubo, shared_midpoint, &options, &input, moments, NULL, &error));
   CHECK(n_ok[NTIME - 1] == PATHS && fabs(mean[2] - 0.5) < 1e-12 && mean[3] == 1);
   if (me->id % 2 == 1) {
      char wanted[64];
      code = 20 + me->id;
      snprintf(wanted, sizeof wanted, "a callback returned %d and", code);
      EXPECT(SYMSDE_CALLBACK_FAILED, wanted,
             symsde_compute_moments(shared_kubo, shared_midpoint, &options, &input, moments, NULL, &error));
   }
   free(moments);
}

static void read_texts(worker *me) {
   OK(symsde_scheme_certificate(shared_midpoint, me->text, TEXT, NULL, &error));
   CHECK(strcmp(me->text, certificate_alone) == 0);
   CHECK(symsde_build_info(me->text, TEXT, NULL) == 0 && strcmp(me->text, build_alone) == 0);
   CHECK(symsde_status_text(-3 - me->id % 2, me->text, TEXT, NULL) == 0);
   CHECK(strcmp(me->text, me->id % 2 ? "array of the wrong shape" : "unknown name") == 0);
}

static void diagnose(worker *me) {
   const symsde_options options = thread_options();
   const double increment = 0.2;
   double defect = 1, gradients[2];
   int32_t commute[2];

   OK(symsde_symplecticity(shared_pendulum, shared_midpoint, &options, 1, &one, &zero, &increment, &defect, &error));
   CHECK(defect < 1e-8);
   OK(symsde_commutator(shared_pendulum, 0, 1, &one, &zero, gradients, commute, me->text, TEXT, NULL, NULL, &error));
   CHECK(strncmp(me->text, "the noises commute", 18) == 0);
}

enum { TASKS = 8 };
static void (*const tasks[TASKS])(worker *) = {
    use_shared_models,  use_own_model,   be_refused, fail_in_a_callback,
    fail_in_every_path, compute_moments, read_texts, diagnose,
};

static void *work(void *argument) {
   worker *me = argument;

   pthread_barrier_wait(&barrier);
   for (int round = 0; round < ROUNDS; round++) {
      /* threads begin with different tasks, so that every two tasks meet */
      for (int task = 0; task < TASKS; task++) {
         tasks[(task + me->id + round) % TASKS](me);
      }
   }
   me->passed = passed;
   me->failed = failed;
   return NULL;
}

int main(void) {
   shared_kubo = new_kubo();
   shared_midpoint = new_scheme("midpoint");
   shared_pendulum = new_pendulum(&shared_user);
   run_into(&kubo_alone, shared_kubo);
   run_into(&pendulum_alone, shared_pendulum);
   CHECK(!same(&kubo_alone, &pendulum_alone));
   OK(symsde_scheme_certificate(shared_midpoint, certificate_alone, TEXT, NULL, &error));
   CHECK(symsde_build_info(build_alone, TEXT, NULL) == 0);

   pthread_barrier_init(&barrier, NULL, THREADS);
   for (int i = 0; i < THREADS; i++) {
      workers[i].id = i;
      workers[i].user = shared_user;
      CHECK(pthread_create(&workers[i].thread, NULL, work, &workers[i]) == 0);
   }
   for (int i = 0; i < THREADS; i++) {
      CHECK(pthread_join(workers[i].thread, NULL) == 0);
      passed += workers[i].passed;
      failed += workers[i].failed;
   }
   symsde_model_delete(&shared_kubo);
   symsde_model_delete(&shared_pendulum);
   symsde_scheme_delete(&shared_midpoint);
   return close_report();
}
