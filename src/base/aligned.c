/* SPDX-License-Identifier: BSD-3-Clause
 * Memory at the size of a vector register. gfortran's allocate takes malloc's, at multiples of 16 bytes: then half of
 * all loads of 64 bytes touch two cache lines, other ones in every thread and run, and a step takes up to a third
 * more time. The linker's --wrap=malloc sends the library's own calls here, and no others; free() takes back either
 * kind. */
#include <stdint.h>
#include <stdlib.h>

#define CACHE_LINE ((size_t)64)
#define SMALL ((size_t)2048) /* the size of a column of a usual block; smaller requests are descriptors and texts */

void *__real_malloc(size_t size);
__attribute__((visibility("hidden"))) void *__wrap_malloc(size_t size);

void *__wrap_malloc(size_t size) {
   if (size < SMALL || size > SIZE_MAX - CACHE_LINE)
      return __real_malloc(size);
   return aligned_alloc(CACHE_LINE, (size + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE);
}
