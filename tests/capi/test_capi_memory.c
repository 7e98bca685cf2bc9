/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A process whose memory is used up: runs are refused, nothing large is taken before memory is judged, and a later
 * call succeeds where there is memory again.
 */
#define _POSIX_C_SOURCE 200112L /* setrlimit */
#include "run.h"

#include <sys/resource.h>

static arrays a;
static double t[NTIME], mean[3 * NTIME], variance[3 * NTIME], se_mean[3 * NTIME];
static int64_t n_ok[NTIME];
static symsde_moments moments;

/* Limit the address space to 4 MB beyond the present use, and take all pieces of at least `least` bytes from it and
 * from the heap. */
static void use_up(size_t least) {
   struct rlimit limit;
   for (limit.rlim_cur = (rlim_t)1 << 20; limit.rlim_cur < (rlim_t)1 << 40; limit.rlim_cur += (rlim_t)1 << 22) {
      limit.rlim_max = RLIM_INFINITY;
      setrlimit(RLIMIT_AS, &limit);
      void *volatile piece = malloc((size_t)1 << 22);
      if (piece != NULL) {
         free(piece);
         break;
      }
   }
   for (size_t size = (size_t)1 << 22; size >= least; size /= 2) {
      void *volatile piece;
      do {
         piece = malloc(size);
      } while (piece != NULL);
   }
}

static void give_back(void) {
   const struct rlimit limit = {RLIM_INFINITY, RLIM_INFINITY};
   CHECK(setrlimit(RLIMIT_AS, &limit) == 0);
}

int main(void) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   options.threads = 1;
   symsde_moments_init(&moments);
   moments.t = t;
   moments.n_ok = n_ok;
   moments.mean = mean;
   moments.variance = variance;
   moments.se_mean = se_mean;
   for (size_t least = 16384; least >= 2048; least /= 2) {
      use_up(least);
      EXPECT(SYMSDE_OUT_OF_MEMORY, "bytes of memory",
             symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
      EXPECT(SYMSDE_OUT_OF_MEMORY, "bytes of memory",
             symsde_compute_moments(model, scheme, &options, &input, &moments, NULL, &error));
      give_back();
   }
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_compute_moments(model, scheme, &options, &input, &moments, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return close_report();
}
