/* SPDX-License-Identifier: BSD-3-Clause
 * What a program holds on the heap, and the most it has held since it was asked to look: every allocation of this
 * program and of the libraries it uses comes here before it goes to glibc. */
#include <errno.h>
#include <malloc.h>
#include <stdatomic.h>
#include <stddef.h>

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *old, size_t size);
void *__libc_memalign(size_t alignment, size_t size);
void __libc_free(void *memory);
void *aligned_alloc(size_t alignment, size_t size);
int posix_memalign(void **memory, size_t alignment, size_t size);
void heap_watch(void);
double heap_most(void);

static atomic_llong held, most, begin;

static void *took(void *memory) {
   if (memory == NULL)
      return NULL;
   const long long bytes = (long long)malloc_usable_size(memory);
   const long long now = atomic_fetch_add(&held, bytes) + bytes;
   long long top = atomic_load(&most);
   while (now > top && !atomic_compare_exchange_weak(&most, &top, now)) {
   }
   return memory;
}

static void gives(void *memory) {
   if (memory != NULL)
      atomic_fetch_sub(&held, (long long)malloc_usable_size(memory));
}

/* start watching: the bytes held at this moment are the base */
void heap_watch(void) {
   begin = held;
   most = held;
}

/* the most bytes held at one time since heap_watch, minus the bytes held when heap_watch was called */
double heap_most(void) {
   return (double)(most - begin);
}

void *malloc(size_t size) {
   return took(__libc_malloc(size));
}

void *calloc(size_t count, size_t size) {
   return took(__libc_calloc(count, size));
}

void *realloc(void *old, size_t size) {
   gives(old);
   return took(__libc_realloc(old, size));
}

void *memalign(size_t alignment, size_t size) {
   return took(__libc_memalign(alignment, size));
}

void *aligned_alloc(size_t alignment, size_t size) {
   return took(__libc_memalign(alignment, size));
}

int posix_memalign(void **memory, size_t alignment, size_t size) {
   *memory = took(__libc_memalign(alignment, size));
   return *memory == NULL ? ENOMEM : 0;
}

void free(void *memory) {
   gives(memory);
   __libc_free(memory);
}
