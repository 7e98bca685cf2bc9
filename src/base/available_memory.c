/* SPDX-License-Identifier: BSD-3-Clause
 * Whether memory can be had, asked of the operating system itself: a mapping is made and given back untouched, so that
 * limits of the process (ulimit -v) and of the machine answer, and the allocator of the host notices nothing. Limits of
 * control groups answer to nobody: they are read (group_memory.c). */
#define _DEFAULT_SOURCE /* sys/mman.h: mappings without a file */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#ifndef MAP_ANONYMOUS
#define MAP_ANONYMOUS MAP_ANON
#endif
#define ARENA ((size_t)64 << 20) /* address space that malloc reserves for a thread */
#define LITTLE 67108864.0 /* memory that every machine has: smaller requests are not checked */
/* control groups are not checked below this: reading their files takes as long as a short run */
#define GROUP 25165824.0

static int can_map(size_t bytes, int protection) {
   if (bytes == 0)
      return 1;
   void *given = mmap(NULL, bytes, protection, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
   if (given == MAP_FAILED)
      return 0;
   return munmap(given, bytes) == 0;
}

/* Stack of a thread that OpenMP makes: OMP_STACKSIZE (kilobytes, or with B, K, M, G), else the system's. */
static size_t stack_size(void) {
   size_t size = (size_t)8 << 20;
   const char *given = getenv("OMP_STACKSIZE");
   if (given != NULL) {
      char *end;
      const unsigned long long n = strtoull(given, &end, 10);
      while (*end == ' ')
         end++;
      const int shift = *end == 'B' || *end == 'b'   ? 0
                        : *end == 'M' || *end == 'm' ? 20
                        : *end == 'G' || *end == 'g' ? 30
                                                     : 10;
      if (end != given && n <= (SIZE_MAX >> shift))
         return (size_t)n << shift;
   }
   pthread_attr_t usual;
   if (pthread_attr_init(&usual) == 0) {
      pthread_attr_getstacksize(&usual, &size);
      pthread_attr_destroy(&usual);
   }
   return size;
}

/* Bytes of memory of the machine. */
static double machine(void) {
   const double bytes = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
   return bytes > 0 ? bytes : HUGE_VAL;
}

/* is_unbounded returns 1 if Linux cannot refuse a mapping of a few megabytes: the process has no limit on its address
 * space or its data, and Linux does not limit the sum promised to all processes (strict overcommit). The caller then
 * makes no test mapping, which would take as long as a step of a short run. */
#if defined(__linux__)
#include <stdio.h>

__attribute__((visibility("hidden"))) double symsde_groups_leave(void);

static int strict_overcommit = 1; /* written once, before any other function of the library can be called */

__attribute__((constructor)) static void ask_policy(void) {
   FILE *file = fopen("/proc/sys/vm/overcommit_memory", "r");
   if (file == NULL)
      return;
   const int policy = fgetc(file);
   strict_overcommit = policy != '0' && policy != '1';
   fclose(file);
}

static int is_unbounded(void) {
   struct rlimit space, data;
   return !strict_overcommit && getrlimit(RLIMIT_AS, &space) == 0 && space.rlim_cur == RLIM_INFINITY &&
          getrlimit(RLIMIT_DATA, &data) == 0 && data.rlim_cur == RLIM_INFINITY;
}
#else
static int is_unbounded(void) { return 0; }
#endif

/* 1 if so many bytes, and threads besides the calling one, are available now. */
__attribute__((visibility("hidden"))) int symsde_memory_available(double bytes, int threads);
int symsde_memory_available(double bytes, int threads) {
   if (!(bytes < 4e18) || (bytes > LITTLE && bytes > machine()))
      return 0;
#if defined(__linux__)
   if (bytes > GROUP && bytes > symsde_groups_leave())
      return 0;
#endif
   if (threads == 0 && bytes <= LITTLE && is_unbounded())
      return 1;
   if (threads > 0 && !can_map((size_t)bytes + (size_t)threads * (stack_size() + ARENA), PROT_NONE))
      return 0;
   return can_map((size_t)bytes, PROT_READ | PROT_WRITE);
}
#else
int symsde_memory_available(double bytes, int threads);
int symsde_memory_available(double bytes, int threads) { return bytes < 4e18; }
#endif
