/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A host that rounds in another way than the threads of OpenMP did when they began, or flushes denormal numbers: all
 * threads of a run compute as the one that called, and afterwards as before.
 */
#include "run.h"

#include <fenv.h>
#include <string.h>
#ifdef __SSE2__
#include <xmmintrin.h>
#endif

enum { NEAREST, UPWARD, DOWNWARD, TO_ZERO, FLUSHED, NMODE };

static arrays found[NMODE], other;

static const int rounding[NMODE] = {FE_TONEAREST, FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO, FE_TONEAREST};

static void set_mode(int mode) {
   fesetround(rounding[mode]);
#if defined(__SSE2__)
   _mm_setcsr((_mm_getcsr() & ~0x8040u) | (mode == FLUSHED ? 0x8040u : 0));
#elif defined(__aarch64__)
   unsigned long long bits;
   __asm__ volatile("mrs %0, fpcr" : "=r"(bits));
   bits = (bits & ~(1ull << 24)) | ((unsigned long long)(mode == FLUSHED) << 24);
   __asm__ volatile("msr fpcr, %0" : : "r"(bits));
#endif
}

/* one path in seven has denormal states */
static void run_in(int mode, int32_t threads, arrays *result) {
   static double q0[PATHS], p0[PATHS];
   for (int i = 0; i < PATHS; i++) {
      q0[i] = i % 7 ? 0.3 : 3e-310;
      p0[i] = i % 7 ? 0.2 : 0;
   }
   symsde_model model = new_kubo();
   symsde_scheme scheme = NULL;
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   symsde_options options = some_options();
   options.threads = threads;
   options.lanes = 8; /* 38 blocks */
   symsde_input input = some_input(q0, p0);
   input.q0_paths = input.p0_paths = PATHS;
   symsde_paths paths = paths_in(result, 0);
   set_mode(mode);
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fegetround() == rounding[mode]);
   set_mode(NEAREST);
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&model);
}

static int same(const arrays *a, const arrays *b) {
   return memcmp(a->q, b->q, sizeof a->q) == 0 && memcmp(a->p, b->p, sizeof a->p) == 0;
}

int main(void) {
   run_in(NEAREST, 3, &other); /* the first parallel run creates the threads */
   for (int mode = NEAREST; mode < NMODE; mode++) {
      run_in(mode, 1, &found[mode]);
      for (int32_t threads = 2; threads <= 3; threads++) {
         run_in(mode, threads, &other);
         CHECK(same(&found[mode], &other));
         run_in(NEAREST, threads, &other);
         CHECK(same(&found[NEAREST], &other));
      }
#if !defined(__SSE2__) && !defined(__aarch64__)
      if (mode == FLUSHED)
         continue;
#endif
      CHECK(mode == NEAREST || !same(&found[NEAREST], &found[mode]));
   }
   return close_report();
}
