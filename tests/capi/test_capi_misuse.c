/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Every misuse of a run through the C interface is refused by its own words, and the process goes on.
 */
#include "run.h"

static arrays a;
static double dw[STEPS * PATHS];

/* every misuse of a run is refused with a message that names it */
static void test_misuse(void) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options good = some_options(), options = good;
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;
   const double nan_value = NAN;

#define REFUSE(status, words)                                                                                          \
   EXPECT(status, words, symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error))
#define OPTION(member, value, status, words)                                                                           \
   options = good;                                                                                                     \
   options.member = value;                                                                                             \
   REFUSE(status, words)
   OPTION(step, 0, SYMSDE_INVALID_ARGUMENT, "step");
   OPTION(step, NAN, SYMSDE_INVALID_ARGUMENT, "step");
   OPTION(t0, INFINITY, SYMSDE_INVALID_ARGUMENT, "t0");
   OPTION(steps, -4, SYMSDE_INVALID_ARGUMENT, "steps = -4");
   OPTION(steps, 42, SYMSDE_INVALID_ARGUMENT, "42|multiple|save_every");
   OPTION(save_every, 0, SYMSDE_INVALID_ARGUMENT, "save_every");
   OPTION(paths, 0, SYMSDE_INVALID_ARGUMENT, "paths = 0");
   OPTION(paths, INT64_MAX, SYMSDE_TOO_LARGE, "paths");
   OPTION(steps, (int64_t)4 << 50, SYMSDE_TOO_LARGE, "steps");
   OPTION(first_step, -1, SYMSDE_INVALID_ARGUMENT, "first_step");
   OPTION(lanes, 12, SYMSDE_INVALID_ARGUMENT, "multiple of 8");
   OPTION(threads, -1, SYMSDE_INVALID_ARGUMENT, "threads");
   OPTION(refine, 31, SYMSDE_INVALID_ARGUMENT, "refine = 31");
   OPTION(refine, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "refine = -2147483648");
   OPTION(lanes, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "block size -2147483648");
   OPTION(threads, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "threads = -2147483648");
   OPTION(max_iter, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "max_iter = -2147483648");
   OPTION(max_iter, INT32_MAX, SYMSDE_INVALID_ARGUMENT, "max_iter = 2147483647");
   OPTION(fixed_point, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "fixed_point = -2147483648");
   OPTION(correction, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "correction");
   OPTION(steps, INT64_MIN, SYMSDE_INVALID_ARGUMENT, "steps = -9223372036854775808");
   OPTION(steps, INT64_MAX, SYMSDE_INVALID_ARGUMENT, "multiple");
   OPTION(paths, INT64_MIN, SYMSDE_INVALID_ARGUMENT, "paths = -9223372036854775808");
   OPTION(save_every, INT64_MIN, SYMSDE_INVALID_ARGUMENT, "save_every");
   OPTION(first_path, INT64_MIN, SYMSDE_INVALID_ARGUMENT, "first_path");
   OPTION(first_path, INT64_MAX, SYMSDE_TOO_LARGE, "first_path");
   OPTION(first_step, INT64_MAX, SYMSDE_TOO_LARGE, "first_step");
   OPTION(areas, 2, SYMSDE_INVALID_ARGUMENT, "areas = 2");
   OPTION(areas, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "areas = -2147483648");
   OPTION(areas, SYMSDE_AREAS_LAW, SYMSDE_INCOMPATIBLE, "areas in law|midpoint|midpoint_areas");
   OPTION(damping_noise, 5, SYMSDE_INVALID_ARGUMENT, "damping_noise = 5|0 (its law)");
   OPTION(damping_noise, INT32_MIN, SYMSDE_INVALID_ARGUMENT, "damping_noise = -2147483648");
   OPTION(damping_noise, SYMSDE_DAMPING_NOISE_PATH, SYMSDE_INCOMPATIBLE, "not damped|gauss_dkdkd");
   OPTION(correction, 9, SYMSDE_INVALID_ARGUMENT, "correction");
   OPTION(correction, SYMSDE_CORRECTION_MEAN, SYMSDE_INCOMPATIBLE, "midpoint|correction");
   OPTION(max_iter, 0, SYMSDE_INVALID_ARGUMENT, "");
   OPTION(struct_size, 7, SYMSDE_INVALID_ARGUMENT, "struct_size of options is 7");
   OPTION(struct_size, 0, SYMSDE_INVALID_ARGUMENT, "symsde_options_init first");
   OPTION(struct_size, sizeof options + 8, SYMSDE_INVALID_ARGUMENT, "symsde_options_init first|header");
   options = good;
   options.steps = (int64_t)1 << 46;
   options.paths = (int64_t)1 << 30;
   options.save_every = 1;
   REFUSE(SYMSDE_TOO_LARGE, "q has");
   options = good;
   input.q0 = NULL;
   REFUSE(SYMSDE_INVALID_ARGUMENT, "q0 is NULL");
   input = some_input(&one, &nan_value);
   REFUSE(SYMSDE_INVALID_ARGUMENT, "finite");
   input = some_input(&one, &zero);
   input.p0_paths = -1;
   REFUSE(SYMSDE_WRONG_SHAPE, "p0|negative");
   input.p0_paths = 0;
   REFUSE(SYMSDE_WRONG_SHAPE, "300");
   input = some_input(&one, &zero);
   input.struct_size = 0;
   REFUSE(SYMSDE_INVALID_ARGUMENT, "symsde_input_init first");
   input = some_input(&one, &zero);
   paths.failed_step = NULL;
   REFUSE(SYMSDE_INVALID_ARGUMENT, "failed_step is NULL");
   paths = paths_in(&a, 0);
   paths.struct_size = 0;
   REFUSE(SYMSDE_INVALID_ARGUMENT, "symsde_paths_init first");
   paths = paths_in(&a, 0);
   report.struct_size = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "symsde_report_init first",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_simulate(NULL, scheme, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "scheme", symsde_simulate(model, NULL, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "options is NULL",
          symsde_simulate(model, scheme, NULL, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "input is NULL",
          symsde_simulate(model, scheme, &options, NULL, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "paths is NULL",
          symsde_simulate(model, scheme, &options, &input, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "t is NULL", symsde_saved_times(&options, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "options is NULL", symsde_saved_times(NULL, a.t, &error));
   options.save_every = 3;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "not a multiple of save_every", symsde_saved_times(&options, a.t, &error));
   options = some_options();
   EXPECT(SYMSDE_INVALID_ARGUMENT, "dw is NULL", symsde_increments(model, NULL, &options, NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_increments(NULL, NULL, &options, dw, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "options is NULL", symsde_increments(model, NULL, NULL, dw, &error));
   /* after all refusals the run still works */
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* a gradient that scales an input, q or the input that `user` selects, or leaves an output unwritten */
static const int of_w = 1, of_p = 2;

static int scribbling(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                      double *hq, double *hp, void *user) {
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * q[i];
      hp[i] = w[i] * p[i];
      ((double *)(uintptr_t)(user == &of_w ? w : user == &of_p ? p : q))[i] *= 0.5;
   }
   return (void)ndof, (void)nham, (void)t, 0;
}

static int lazy(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *hq,
                double *hp, void *user) {
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * q[i];
   }
   return (void)ndof, (void)nham, (void)t, (void)p, (void)hp, (void)user, 0;
}

static int counting(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   ++*(int *)user;
   return (void)nlane, (void)ndof, (void)nham, (void)t, (void)w, (void)q, (void)p, (void)hq, (void)hp, 31;
}

/* after a callback has failed, it is not called for further blocks */
static void test_failed_callbacks(void) {
   enum { N = 5000 };
   static double w[N], q[N], p[N], hq[N];
   int calls = 0;
   symsde_model model;
   symsde_traits traits;

   symsde_traits_init(&traits);
   traits.nnoise = 0;
   OK(symsde_model_new("counting", &traits, counting, NULL, NULL, NULL, &calls, &model, &error));
   EXPECT(SYMSDE_CALLBACK_FAILED, "31", symsde_model_gradient(model, N, 0, w, q, p, hq, NULL, &error));
   CHECK(calls == 1);
   symsde_model_delete(&model);
}

static void test_wrong_gradients(void) {
   symsde_model model;
   symsde_traits traits;

   symsde_traits_init(&traits);
   for (int i = 0; i < 3; i++) {
      void *user = i == 0 ? NULL : (void *)(uintptr_t)(i == 1 ? &of_w : &of_p);
      OK(symsde_model_new("scribbling", &traits, scribbling, NULL, NULL, NULL, user, &model, &error));
      EXPECT(SYMSDE_FALSE_TRAIT, "scribbling|writes into q, p or w|copies",
             symsde_model_probe(model, 0, &one, &one, &error));
      symsde_model_delete(&model);
   }
   OK(symsde_model_new("lazy", &traits, lazy, NULL, NULL, NULL, NULL, &model, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "lazy|dS/dp_1|write all of every output",
          symsde_model_probe(model, 0, &one, &one, &error));
   symsde_model_delete(&model);
}

int main(void) {
   test_wrong_gradients();
   test_failed_callbacks();
   test_misuse();
   return close_report();
}
