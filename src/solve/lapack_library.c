/* SPDX-License-Identifier: BSD-3-Clause
 * The LAPACK and the BLAS of this process: whose they are, and their threads.
 *
 * Bits of what LAPACK solves depend on its vendor, its version and, where it chooses among kernels, the processor that it
 * chose for. One file name stands for libraries of several vendors (liblapack.so.3), so the file that holds dgetrf is
 * asked, and the one that holds dgemm, which does the work.
 *
 * Many small systems are solved on threads of our own, and threads within each solve slow that down many times over:
 * while any call computes, the BLAS has one. The number belongs to the whole process, and calls of several host threads
 * overlap. So they are counted: the first one in remembers what the host chose, the last one out gives it back. This,
 * with the functions of the BLAS, is the one storage of the library that several threads write. The lock is POSIX's,
 * which the thread sanitizer knows.
 *
 * A BLAS with threads may hide the functions that set them: so does Debian's BLIS where it stands for libblas.so.3, and
 * an archive that is linked in. As many threads as OMP_NUM_THREADS names would wait for each other in each of ours: such
 * a BLAS is not used, see lapack_serves. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <limits.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#pragma GCC visibility push(hidden)
void lapack_name(char *text, int size);
int lapack_serves(void);
void blas_threads_take(void);
void blas_threads_give_back(void);
#pragma GCC visibility pop

/* file names of linked archives, in builds that link archives */
#ifndef SYMSDE_LAPACK_FILE
#define SYMSDE_LAPACK_FILE ""
#define SYMSDE_BLAS_FILE ""
#endif

extern void dgetrf_(void), dgemm_(void), ilaver_(int *major, int *minor, int *patch);

enum { NAME = 96 };

typedef void (*any_function)(void);

/* MKL's own words for its version */
typedef struct {
   int major, minor, patch;
   char *status, *build, *processor, *platform;
} mkl_version;

/* The function of a library, or of the running program; NULL if there is none. */
static any_function function_of(void *library, const char *name) {
   any_function found;
   *(void **)&found = dlsym(library, name);
   return found;
}

static const char *base_of(const char *path) {
   const char *const slash = strrchr(path, '/');
   return slash == NULL ? path : slash + 1;
}

/* function_of a library that may not be loaded. */
static any_function loaded_function(void *library, const char *name) {
   return library == NULL ? NULL : function_of(library, name);
}

/* The file that contains a function, with links resolved; the archive's name if that is the file of this code. */
static void find_file(any_function function, const char *archive, char path[PATH_MAX]) {
   const any_function here = (any_function)lapack_name;
   void *addresses[2];
   Dl_info where, own;
   memcpy(&addresses[0], &function, sizeof function);
   memcpy(&addresses[1], &here, sizeof here);
   if (dladdr(addresses[0], &where) == 0 || dladdr(addresses[1], &own) == 0 || where.dli_fbase == own.dli_fbase ||
       realpath(where.dli_fname, path) == NULL) {
      snprintf(path, PATH_MAX, "%s", archive);
   }
}

/* "OpenBLAS 0.3.21, Zen", "BLIS 0.9.0", "MKL 2026.2", "ATLAS 3.10.3", "netlib 3.11.0", or the name of the file. */
static void name_of(const char *path, char text[NAME]) {
   void *const library = path[0] == '\0' ? NULL : dlopen(path, RTLD_LAZY | RTLD_NOLOAD);
   const char *const base = base_of(path);
   char *(*const config)(void) = (char *(*)(void))loaded_function(library, "openblas_get_config");
   char *(*const core)(void) = (char *(*)(void))loaded_function(library, "openblas_get_corename");
   const char *(*const blis)(void) = (const char *(*)(void))loaded_function(library, "bli_info_get_version_str");
   void (*const mkl)(mkl_version *) = (void (*)(mkl_version *))loaded_function(library, "MKL_Get_Version");
   const char *const version = strstr(base, ".so.");
   if (config != NULL) {
      char vendor[32] = "", number[32] = "";
      sscanf(config(), "%31s %31s", vendor, number);
      snprintf(text, NAME, "%s %s, %.20s", vendor, number, core == NULL ? "unknown processor" : core());
   } else if (mkl != NULL) {
      mkl_version told;
      mkl(&told);
      snprintf(text, NAME, "MKL %d.%d.%d, %.60s", told.major, told.minor, told.patch, told.processor);
   } else if (blis != NULL) {
      snprintf(text, NAME, "BLIS %.40s", blis());
   } else if (strstr(path, "blis") != NULL) {
      snprintf(text, NAME, "BLIS");
   } else if (strstr(path, "openblas") != NULL) {
      snprintf(text, NAME, "OpenBLAS");
   } else if (strstr(path, "atlas") != NULL) {
      snprintf(text, NAME, "ATLAS%s%.20s", version == NULL ? "" : " ", version == NULL ? "" : version + 4);
   } else if (strncmp(base, "liblapack", 9) == 0 || strncmp(base, "libblas", 7) == 0) {
      int major = 0, minor = 0, patch = 0;
      ilaver_(&major, &minor, &patch);
      snprintf(text, NAME, "netlib %d.%d.%d", major, minor, patch);
   } else {
      snprintf(text, NAME, "%.60s", base[0] == '\0' ? "unknown" : base);
   }
   if (library != NULL) {
      dlclose(library);
   }
}

/* Write the name of LAPACK, and of its BLAS if the vendor differs, into a text of `size` characters. */
void lapack_name(char *text, int size) {
   char lapack_file[PATH_MAX], blas_file[PATH_MAX], lapack[NAME], blas[NAME];
   find_file(dgetrf_, SYMSDE_LAPACK_FILE, lapack_file);
   find_file(dgemm_, SYMSDE_BLAS_FILE, blas_file);
   name_of(lapack_file, lapack);
   name_of(blas_file, blas);
   if (strcmp(lapack, blas) == 0) {
      snprintf(text, (size_t)size, "%s", lapack);
   } else {
      snprintf(text, (size_t)size, "%s with the BLAS of %s", lapack, blas);
   }
}

enum { OPENBLAS, MKL, BLIS, VENDORS };

/* functions for the number of threads in threaded BLAS libraries; they are looked up in the running program */
static const char *const readers[VENDORS] = {"openblas_get_num_threads", "MKL_Get_Max_Threads",
                                             "bli_thread_get_num_threads"};
static const char *const setters[VENDORS] = {"openblas_set_num_threads", "MKL_Set_Num_Threads",
                                             "bli_thread_set_num_threads"};
/* words in the file names of these libraries, in the same order */
static const char *const words[VENDORS] = {"openblas", "mkl", "blis"};

static pthread_mutex_t blas_lock = PTHREAD_MUTEX_INITIALIZER;
static int blas_users, blas_sought, blas_serves, blas_choice[VENDORS];
static any_function blas_reader[VENDORS], blas_setter[VENDORS];

/* Both functions of a vendor, or none, and whether the BLAS may be used. The search takes longer than a short run,
 * so it is done once: the BLAS of this library is loaded with it. */
static void seek_functions(void) {
   char path[PATH_MAX];
   if (blas_sought) {
      return;
   }
   find_file(dgemm_, SYMSDE_BLAS_FILE, path);
   blas_serves = 1;
   for (int i = 0; i < VENDORS; i++) {
      blas_reader[i] = function_of(RTLD_DEFAULT, readers[i]);
      blas_setter[i] = function_of(RTLD_DEFAULT, setters[i]);
      if (blas_setter[i] == NULL) {
         blas_reader[i] = NULL;
      }
      if (strstr(path, words[i]) != NULL && blas_reader[i] == NULL) {
         blas_serves = 0;
      }
   }
   blas_sought = 1;
}

/* Threads of a vendor's BLAS; 0 if unknown. BLIS counts in 64 bits. */
static int read_threads(int vendor) {
   if (blas_reader[vendor] == NULL) {
      return 0;
   }
   return vendor == BLIS ? (int)((int64_t (*)(void))blas_reader[vendor])() : ((int (*)(void))blas_reader[vendor])();
}

static void set_threads(int vendor, int number) {
   if (vendor == BLIS) {
      ((void (*)(int64_t))blas_setter[vendor])(number);
   } else {
      ((void (*)(int))blas_setter[vendor])(number);
   }
}

/* Whether LAPACK may solve systems: 0 if its BLAS cannot be kept to one thread. */
int lapack_serves(void) {
   pthread_mutex_lock(&blas_lock);
   seek_functions();
   const int serves = blas_serves;
   pthread_mutex_unlock(&blas_lock);
   return serves;
}

/* The BLAS uses one thread from now on. */
void blas_threads_take(void) {
   pthread_mutex_lock(&blas_lock);
   if (blas_users++ == 0) {
      seek_functions();
      for (int i = 0; i < VENDORS; i++) {
         blas_choice[i] = read_threads(i);
         if (blas_choice[i] > 1) {
            set_threads(i, 1);
         }
      }
   }
   pthread_mutex_unlock(&blas_lock);
}

/* Undo one call of blas_threads_take. */
void blas_threads_give_back(void) {
   pthread_mutex_lock(&blas_lock);
   if (--blas_users == 0) {
      for (int i = 0; i < VENDORS; i++) {
         if (blas_choice[i] > 1) {
            set_threads(i, blas_choice[i]);
         }
      }
   }
   pthread_mutex_unlock(&blas_lock);
}
