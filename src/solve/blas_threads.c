/* SPDX-License-Identifier: BSD-3-Clause
 * The threads of the process's BLAS. Many small systems are solved on threads of our own, and threads within each solve
 * slow that down many times over: while any call computes, the BLAS has one.
 *
 * The number belongs to the whole process, and calls of several host threads overlap. So they are counted: the first one
 * in remembers what the host chose, the last one out gives it back. This, with the two functions of the BLAS, is the one
 * storage of the library that several threads write. The lock is POSIX's, which the thread sanitizer knows. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>

__attribute__((visibility("hidden"))) void blas_threads_take(void);
__attribute__((visibility("hidden"))) void blas_threads_give_back(void);

static pthread_mutex_t blas_lock = PTHREAD_MUTEX_INITIALIZER;
static int blas_users, blas_choice, blas_sought;
static int (*blas_reader)(void);
static void (*blas_setter)(int);

/* what the BLAS libraries that have threads call the two functions; they are looked for in the running program */
static const char *const readers[] = {"openblas_get_num_threads", "MKL_Get_Max_Threads"};
static const char *const setters[] = {"openblas_set_num_threads", "MKL_Set_Num_Threads"};

static void *address_of(const char *const names[2]) {
   void *const first = dlsym(RTLD_DEFAULT, names[0]);
   return first != NULL ? first : dlsym(RTLD_DEFAULT, names[1]);
}

/* Both, or none. It takes longer than a short run, so it is done once: the BLAS of this library is there from its start. */
static void seek_functions(void) {
   *(void **)&blas_reader = address_of(readers);
   *(void **)&blas_setter = address_of(setters);
   if (blas_setter == NULL) {
      blas_reader = NULL;
   }
   blas_sought = 1;
}

/* One thread from now on. */
void blas_threads_take(void) {
   pthread_mutex_lock(&blas_lock);
   if (blas_users++ == 0) {
      if (!blas_sought) {
         seek_functions();
      }
      blas_choice = blas_reader == NULL ? 0 : blas_reader(); /* 0 where the BLAS does not tell */
      if (blas_choice > 1) {
         blas_setter(1);
      }
   }
   pthread_mutex_unlock(&blas_lock);
}

/* Undo one call of blas_threads_take. */
void blas_threads_give_back(void) {
   pthread_mutex_lock(&blas_lock);
   if (--blas_users == 0 && blas_choice > 1) {
      blas_setter(blas_choice);
   }
   pthread_mutex_unlock(&blas_lock);
}
