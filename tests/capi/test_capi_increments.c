/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Given increments in another order of memory, symsde_input.increment_strides.
 */
#include "check.h"

/* increments [path][step][noise], and those of a larger array, give the bits of [step][noise][path] */
static void test_order_of_increments(void) {
   enum { STEPS = 20, NOISES = 2, MANY = 19 };
   static double dw[STEPS][NOISES][MANY], by_path[MANY][STEPS][NOISES], wide[STEPS][2 * NOISES][3 * MANY];
   const int64_t path_first[3] = {NOISES, 1, STEPS * NOISES}, part[3] = {2 * NOISES * 3 * MANY, 3 * MANY, 3};
   const int64_t backward[3] = {-NOISES, 1, STEPS * NOISES}, far[3] = {INT64_C(1) << 60, 1, NOISES};
   const double start = 0.4;
   int32_t status[MANY];
   int64_t failed_step[MANY];
   double q[3][2][1][MANY], p[2][1][MANY], exact[3][STEPS + 1][1][MANY], pe[STEPS + 1][1][MANY];
   symsde_model model = NULL, kubo = NULL;
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options;
   symsde_input input;
   symsde_paths paths;

   OK(symsde_model_get("synchrotron", 0, NULL, NULL, &model, &error));
   OK(symsde_model_get("additive_oscillator", 0, NULL, NULL, &kubo, &error));
   symsde_options_init(&options);
   options.step = 0.05;
   options.steps = options.save_every = STEPS;
   options.paths = MANY;
   options.seed = 5;
   OK(symsde_increments(model, NULL, &options, &dw[0][0][0], &error));
   for (int n = 0; n < STEPS; n++) {
      for (int k = 0; k < NOISES; k++) {
         for (int i = 0; i < MANY; i++) {
            by_path[i][n][k] = wide[n][k][3 * i] = dw[n][k][i];
         }
      }
   }
   symsde_input_init(&input);
   input.q0 = input.p0 = &start;
   input.increment_rows = STEPS;
   input.increment_noises = NOISES;
   input.increment_paths = MANY;
   symsde_paths_init(&paths);
   paths.p = &p[0][0][0];
   paths.status = status;
   paths.failed_step = failed_step;
   for (int way = 0; way < 3; way++) {
      input.increments = way == 0 ? &dw[0][0][0] : way == 1 ? &by_path[0][0][0] : &wide[0][0][0];
      input.increment_strides = way == 0 ? NULL : way == 1 ? path_first : part;
      paths.q = &q[way][0][0][0];
      OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
      options.save_every = 1;
      OK(symsde_exact_solution(kubo, scheme, &options, &input, &exact[way][0][0][0], &pe[0][0][0], &error));
      options.save_every = STEPS;
      CHECK(memcmp(q[way], q[0], sizeof q[0]) == 0 && memcmp(exact[way], exact[0], sizeof exact[0]) == 0);
   }
   CHECK(q[0][1][0][0] != q[0][1][0][1] && q[0][1][0][0] != start);
   wide[7][1][3 * 4] = NAN; /* step 7 of path 4 */
   wide[6][1][3 * 4 + 1] = NAN; /* between paths */
   EXPECT(SYMSDE_INVALID_ARGUMENT, "not finite|step 7 of path 4|column 2",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   input.increment_strides = backward;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "increment_strides|-2|0 or more",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   input.increment_strides = far;
   EXPECT(SYMSDE_TOO_LARGE, "increment_strides|beyond any memory",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&kubo);
   symsde_model_delete(&model);
}

int main(void) {
   test_order_of_increments();
   return close_report();
}
