/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A host whose floating-point traps are on: on good input no operation divides by zero, overflows or is invalid. Every
 * scheme of the catalogue on every model of the catalogue, and all else that computes.
 */
#define _GNU_SOURCE
#include "run.h"

#include <fenv.h>
#include <setjmp.h>
#include <signal.h>

enum { FEW_STEPS = 6, FEW_PATHS = 3, LARGEST = 8, MOST = FEW_PATHS * LARGEST * (FEW_STEPS + 1) };

static double t[FEW_STEPS + 1], q[MOST], p[MOST], other_q[MOST], other_p[MOST], noise[MOST], more[4 * MOST];
static double q0[LARGEST], p0[LARGEST];
static int32_t path_status[FEW_PATHS];
static int64_t failed_step[FEW_PATHS];
static int64_t n_ok[FEW_STEPS + 1];
static symsde_moments moments;
static sigjmp_buf trapped;
static const char *const masses = "n";
static const double few_masses = 4;

static void on_trap(int signal_number) {
   siglongjmp(trapped, signal_number);
}

/* make the call with floating-point traps on; a trap fails the test with the names of call, model and scheme */
#define TRAPPED(call)                                                                                                  \
   do {                                                                                                                \
      if (sigsetjmp(trapped, 1) == 0) {                                                                                \
         feclearexcept(FE_ALL_EXCEPT);                                                                                 \
         feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);                                                      \
         status = (call);                                                                                              \
         fedisableexcept(FE_ALL_EXCEPT);                                                                               \
         passed++;                                                                                                     \
      } else {                                                                                                         \
         fedisableexcept(FE_ALL_EXCEPT);                                                                               \
         failed++;                                                                                                     \
         printf("trapped: %s with %s: %s\n", scheme_name, model_name, #call);                                          \
      }                                                                                                                \
   } while (0)

static symsde_options few_options(void) {
   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.05;
   options.steps = FEW_STEPS;
   options.paths = FEW_PATHS;
   options.seed = 7;
   options.threads = 1;
   return options;
}

static symsde_paths all_paths(void) {
   symsde_paths paths;
   symsde_paths_init(&paths);
   paths.t = t;
   paths.q = q;
   paths.p = p;
   paths.status = path_status;
   paths.failed_step = failed_step;
   return paths;
}

/* every function that takes a model and a scheme; a refused pair is fine */
static void use(const char *model_name, symsde_model model, const char *scheme_name, symsde_scheme scheme) {
   symsde_options options = few_options();
   const symsde_input input = some_input(q0, p0);
   symsde_paths paths = all_paths();
   int status = 0;
   double defect;

   TRAPPED(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   if (status < 0) {
      CHECK(status == SYMSDE_INCOMPATIBLE || status == SYMSDE_MISSING_OPERATION);
      return;
   }
   CHECK(status == SYMSDE_OK);
   TRAPPED(symsde_increments(model, scheme, &options, noise, &error));
   TRAPPED(symsde_symplecticity(model, scheme, &options, 1, q0, p0, noise, &defect, &error));
   TRAPPED(symsde_discrete_action(model, scheme, &options, q, p, noise, more, &error));
   TRAPPED(symsde_euler_lagrange_residual(model, scheme, &options, q, p, noise, more, &error));
   TRAPPED(symsde_stationary_path(model, scheme, &options, q, q + (size_t)FEW_STEPS * FEW_PATHS, NULL, NULL, NULL,
                                  other_q, other_p, path_status, &error));
   options.general = 1;
   TRAPPED(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   options = few_options();
   options.refine = 2;
   TRAPPED(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   options.refine = -2;
   TRAPPED(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   options = few_options();
   options.compensated = 1;
   options.truncation = 2;
   options.truncation_time = 1;
   options.threads = 2;
   options.lanes = 8;
   TRAPPED(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   options = few_options();
   options.correction = SYMSDE_CORRECTION_MEAN;
   options.step = -0.05;
   TRAPPED(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   TRAPPED(symsde_exact_solution(model, scheme, &options, &input, other_q, other_p, &error));
}

/* functions that take no scheme, or whose scheme does not matter */
static void use_model(const char *model_name, symsde_model model) {
   const char *scheme_name = "midpoint";
   symsde_scheme scheme = new_scheme(scheme_name);
   const symsde_options options = few_options();
   const symsde_input input = some_input(q0, p0);
   double gradients[2];
   int32_t commute[2];
   char text[512];
   int status = 0;

   TRAPPED(symsde_model_probe(model, 0, q0, p0, &error));
   CHECK(status == SYMSDE_OK);
   TRAPPED(symsde_commutator(model, 0, 1, q0, p0, gradients, commute, text, sizeof text, NULL, NULL, &error));
   TRAPPED(symsde_exact_solution(model, scheme, &options, &input, q, p, &error));
   TRAPPED(symsde_compute_moments(model, scheme, &options, &input, &moments, NULL, &error));
   CHECK(status == SYMSDE_OK);
   symsde_scheme_delete(&scheme);
}

/* the next line of a list */
static int next_line(const char **list, char *line, size_t size) {
   const size_t length = strcspn(*list, "\n");
   if (length == 0) {
      return 0;
   }
   snprintf(line, size, "%.*s", (int)length, *list);
   *list += length + 1;
   return 1;
}

int main(void) {
   static char models[4096], schemes[4096];
   char model_name[64], scheme_name[64];
   const char *model_list = models, *scheme_list;
   int nused = 0;

   signal(SIGFPE, on_trap);
   symsde_moments_init(&moments);
   moments.t = t;
   moments.n_ok = n_ok;
   moments.mean = more;
   moments.variance = more + MOST;
   moments.se_mean = more + 2 * MOST;
   CHECK(symsde_model_names(models, sizeof models, NULL) == 0 &&
         symsde_scheme_names(schemes, sizeof schemes, NULL) == 0);
   while (next_line(&model_list, model_name, sizeof model_name)) {
      symsde_model model = NULL;
      symsde_traits traits;
      const int is_chain = strcmp(model_name, "fpu_chain") == 0; /* the default of 32 masses would take long */

      OK(symsde_model_get(model_name, is_chain, &masses, &few_masses, &model, &error));
      symsde_traits_init(&traits);
      OK(symsde_model_traits(model, &traits, &error));
      CHECK(traits.ndof <= LARGEST && traits.nnoise <= LARGEST);
      for (int i = 0; i < traits.ndof; i++) {
         q0[i] = 0.3 + 0.01 * i;
         p0[i] = -0.2 + 0.02 * i;
      }
      use_model(model_name, model);
      scheme_list = schemes;
      while (next_line(&scheme_list, scheme_name, sizeof scheme_name)) {
         symsde_scheme scheme = NULL;
         if (strchr(scheme_name, ':') != NULL) {
            strncat(scheme_name, "0.3", sizeof scheme_name - strlen(scheme_name) - 1);
         }
         OK(symsde_scheme_get(scheme_name, &scheme, &error));
         use(model_name, model, scheme_name, scheme);
         symsde_scheme_delete(&scheme);
         nused++;
      }
      symsde_model_delete(&model);
   }
   CHECK(nused >= 200);
   return close_report();
}
