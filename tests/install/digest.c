/* SPDX-License-Identifier: BSD-3-Clause
 * A digest of the bits of paths of nine scenes, one a line: what portable builds compute alike on every processor. */
#include <symsde.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 40, EVERY = 10, TIMES = STEPS / EVERY + 1, PATHS = 37 };

static const char *const scenes[][2] = {
    {"kubo", "midpoint"},
    {"synchrotron", "midpoint"},
    {"synchrotron", "gauss2"},
    {"synchrotron", "lobatto3"},
    {"pendulum", "gauss2_strong32"},
    {"driven_pendulum", "chin4a"},
    {"henon_heiles", "stormer_verlet"},
    {"fpu_chain", "midpoint"},
    {"noncommutative_oscillator", "midpoint_areas"},
};

static void check(int status, const symsde_error *error) {
   if (status != SYMSDE_OK) {
      printf("status %d: %s\n", status, error->message);
      exit(1);
   }
}

/* FNV-1a of the bytes, low ones first, whatever the processor. */
static uint64_t digest(const double *values, size_t n, uint64_t hash) {
   for (size_t i = 0; i < n; i++) {
      uint64_t bits;
      memcpy(&bits, &values[i], sizeof bits);
      for (int byte = 0; byte < 8; byte++) {
         hash = (hash ^ (bits >> (8 * byte) & 0xff)) * UINT64_C(1099511628211);
      }
   }
   return hash;
}

static void run(const char *name, const char *scheme_name) {
   symsde_error error;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_traits traits;
   symsde_options options;
   symsde_input input;
   symsde_paths paths;
   symsde_report report;
   static double t[TIMES];
   static int32_t status[PATHS];
   static int64_t failed_step[PATHS];

   symsde_traits_init(&traits), symsde_options_init(&options), symsde_input_init(&input);
   symsde_paths_init(&paths), symsde_report_init(&report);
   check(symsde_model_get(name, 0, NULL, NULL, &model, &error), &error);
   check(symsde_scheme_get(scheme_name, &scheme, &error), &error);
   check(symsde_model_traits(model, &traits, &error), &error);
   const size_t ndof = (size_t)traits.ndof, size = TIMES * ndof * PATHS;
   double *start = malloc(2 * ndof * sizeof *start), *saved = malloc(2 * size * sizeof *saved);
   if (start == NULL || saved == NULL) {
      exit(1);
   }
   for (size_t i = 0; i < ndof; i++) {
      start[i] = 0.3;
      start[ndof + i] = 0.2;
   }
   options.step = 0.05;
   options.steps = STEPS;
   options.save_every = EVERY;
   options.paths = PATHS;
   options.seed = 5;
   input.q0 = start;
   input.p0 = start + ndof;
   input.q0_paths = input.p0_paths = 1;
   paths.t = t;
   paths.q = saved;
   paths.p = saved + size;
   paths.status = status;
   paths.failed_step = failed_step;
   check(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error), &error);
   printf("%s %s %016llx\n", name, scheme_name,
          (unsigned long long)digest(saved, 2 * size, UINT64_C(14695981039346656037)));
   free(start);
   free(saved);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

int main(void) {
   for (size_t i = 0; i < sizeof scenes / sizeof *scenes; i++) {
      run(scenes[i][0], scenes[i][1]);
   }
   return 0;
}
