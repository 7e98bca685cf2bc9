/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A loop of one's own around single steps: oscillators in random stiffness that bounce off a wall at q = 0.
 *
 *    H = (p^2 + q^2)/2,   H_1 = sigma (p^2 + q^2)/2
 *
 *    cc host_loop.c $(pkg-config --cflags --libs symsde) -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <symsde.h>

enum { PATHS = 1000, STEPS = 2000 };

static void check(int status, const symsde_error *error) {
   if (status == SYMSDE_OK)
      return;
   fprintf(stderr, "status %d: %s\n", status, error->message);
   exit(1);
}

int main(void) {
   const char *keys[] = {"a", "sigma"};
   const double values[] = {1.0, 0.3}, q0 = 1.0, p0 = 0.0;
   symsde_error error;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_run run = NULL;

   check(symsde_model_get("kubo", 2, keys, values, &model, &error), &error);
   check(symsde_scheme_get("midpoint", &scheme, &error), &error);
   symsde_options options;
   symsde_options_init(&options);
   options.step = 0.01;
   options.paths = PATHS;
   options.seed = 1;
   symsde_input input;
   symsde_input_init(&input);
   input.q0 = &q0;
   input.p0 = &p0;
   check(symsde_run_new(model, scheme, &options, &input, &run, &error), &error);
   symsde_model_delete(&model); /* the run has copies */
   symsde_scheme_delete(&scheme);

   /* The arrays of the state stay where they are; between calls they are ours. */
   symsde_state state;
   symsde_state_init(&state);
   check(symsde_run_state(run, &state, &error), &error);
   int bounces = 0;
   for (int step = 0; step < STEPS; step++) {
      check(symsde_run_advance(run, 1, 1, NULL, NULL, &error), &error);
      for (int i = 0; i < PATHS; i++)
         if (state.q[i] < 0) {
            state.q[i] = -state.q[i];
            state.p[i] = -state.p[i];
            bounces++;
         }
   }
   double drift = 0.0;
   for (int i = 0; i < PATHS; i++)
      drift = fmax(drift, fabs(state.q[i] * state.q[i] + state.p[i] * state.p[i] - 1));
   printf("%.2f bounces a path until t = %g, %.2f without noise\n", (double)bounces / PATHS, options.step * STEPS,
          20 / acos(-1.0));
   printf("largest change of p^2 + q^2: %.1e\n", drift); /* the mirror keeps it, and so does the midpoint rule */
   symsde_run_delete(&run);
   return drift < 1e-11 ? 0 : 1;
}
