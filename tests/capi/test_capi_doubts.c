/* SPDX-License-Identifier: BSD-3-Clause
 *
 * What is doubtful: told before the first step, to a function that may refuse the run, and paths that grew.
 */
#include "run.h"

static char heard[4096];
static int nheard, refuses;

static int hear(const char *warnings, void *user) {
   CHECK(user == heard && strlen(warnings) < sizeof heard);
   strcpy(heard, warnings);
   nheard++;
   return refuses;
}

static int never(int64_t done, int64_t total, void *user) {
   (void)done, (void)total, (void)user;
   CHECK(0); /* a refused run takes no step */
   return 1;
}

int main(void) {
   static arrays a;
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("stormer_verlet");
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;
   symsde_run run = NULL;

   OK(symsde_model_get("linear_oscillator", 0, NULL, NULL, &model, &error));
   symsde_report_init(&report);
   CHECK(input.warn == NULL && report.grown == 0);
   input.warn = hear;
   input.warn_user = heard;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(nheard == 0 && report.warnings[0] == 0 && report.grown == 0);

   options.step = 10; /* h omega = 10 */
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(nheard == 1 && strncmp(heard, "h*omega = 10 ", 13) == 0 && strcmp(heard, report.warnings) == 0);
   CHECK(report.grown == PATHS && a.q[(NTIME - 1) * PATHS] * a.q[(NTIME - 1) * PATHS] > 1e60);

   /* gamma h = 1 with midpoint: momenta are too cold, by the factor z/sinh z */
   {
      const double rate = 1, closed = 0;
      symsde_scheme midpoint = new_scheme("midpoint");

      options.step = 1;
      OK(symsde_model_set_damping(model, 1, &rate, 0, &error));
      nheard = 0;
      OK(symsde_simulate(model, midpoint, &options, &input, &paths, &report, &error));
      CHECK(nheard == 1 && strstr(heard, "gamma*h = 1 ") && strstr(heard, " 0.85"));
      CHECK(strncmp(report.damping, "dp = .. - 1 p dt", 16) == 0);
      OK(symsde_model_set_damping(model, 1, &closed, 0, &error));
      OK(symsde_simulate(model, midpoint, &options, &input, &paths, &report, &error));
      CHECK(nheard == 1 && report.damping[0] == 0);
      options.step = 10;
      symsde_scheme_delete(&midpoint);
   }

   nheard = 1;
   refuses = 1;
   input.progress = never;
   EXPECT(SYMSDE_CALLBACK_FAILED, "refused, before its first step",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   EXPECT(SYMSDE_CALLBACK_FAILED, "refused, before its first step",
          symsde_run_new(model, scheme, &options, &input, &run, &error));
   CHECK(nheard == 3 && run == NULL);
   refuses = 0;
   OK(symsde_run_new(model, scheme, &options, &input, &run, &error));
   CHECK(nheard == 4);
   OK(symsde_run_advance(run, 40, 1, NULL, NULL, &error));
   OK(symsde_run_report(run, &report, &error));
   CHECK(report.grown == PATHS);
   symsde_run_delete(&run);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return close_report();
}
