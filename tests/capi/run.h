/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A run of the Kubo oscillator that the test programs vary.
 */
#ifndef SYMSDE_TEST_RUN_H
#define SYMSDE_TEST_RUN_H

#include "check.h"

enum { PATHS = 300, STEPS = 40, SAVE = 4, NTIME = STEPS / SAVE + 1 };

/* arrays of a run with one degree of freedom */
typedef struct arrays {
   double t[STEPS + 1], q[(STEPS + 1) * PATHS], p[(STEPS + 1) * PATHS];
   double last_q[PATHS], last_p[PATHS], q_low[PATHS], p_low[PATHS];
   int32_t status[PATHS];
   int64_t failed_step[PATHS];
} arrays;

static inline symsde_paths paths_in(arrays *a, int all) {
   symsde_paths paths;
   symsde_paths_init(&paths);
   paths.t = a->t;
   paths.q = a->q;
   paths.p = a->p;
   paths.status = a->status;
   paths.failed_step = a->failed_step;
   if (all) {
      paths.last_q = a->last_q;
      paths.last_p = a->last_p;
      paths.q_low = a->q_low;
      paths.p_low = a->p_low;
   }
   return paths;
}

static inline symsde_options some_options(void) {
   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.1;
   options.steps = STEPS;
   options.paths = PATHS;
   options.seed = 0x8000000000000005u; /* the highest bit counts, too */
   options.save_every = SAVE;
   options.t0 = 2;
   return options;
}

static inline symsde_input some_input(const double *q0, const double *p0) {
   symsde_input input;
   symsde_input_init(&input);
   input.q0 = q0;
   input.p0 = p0;
   return input;
}

static inline symsde_model new_kubo(void) {
   symsde_model model = NULL;
   OK(symsde_model_get("kubo", 0, NULL, NULL, &model, &error));
   return model;
}

static const double one = 1, zero = 0;

#endif
