/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A host that loads the library, runs on two threads, and gives it back: threads of OpenMP outlive the run, and must not
 * lose their code. It is loaded again, too.
 */
#define _DEFAULT_SOURCE
#include "check.h"

#include <dlfcn.h>

#define FIND(name) __typeof__(name) *const own_##name = (__typeof__(name) *)find(library, #name)

/* A function of the library, which this program is not linked to. */
static void (*find(void *library, const char *name))(void) {
   void (*function)(void) = NULL;
   void *const found = dlsym(library, name);
   CHECK(found != NULL);
   memcpy(&function, &found, sizeof found);
   return function;
}

static void use(const char *path) {
   void *const library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
   CHECK(library != NULL);
   if (library == NULL) {
      printf("%s\n", dlerror());
      return;
   }
   FIND(symsde_model_get);
   FIND(symsde_model_delete);
   FIND(symsde_scheme_get);
   FIND(symsde_scheme_delete);
   FIND(symsde_options_init);
   FIND(symsde_input_init);
   FIND(symsde_paths_init);
   FIND(symsde_simulate);
   enum { PATHS = 4096 };
   static double t[2], q[2 * PATHS], p[2 * PATHS];
   static int32_t status[PATHS];
   static int64_t failed_step[PATHS];
   const double one = 1;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options;
   symsde_input input;
   symsde_paths paths;
   OK(own_symsde_model_get("kubo", 0, NULL, NULL, &model, &error));
   OK(own_symsde_scheme_get("midpoint", &scheme, &error));
   own_symsde_options_init(&options);
   options.step = 0.1;
   options.steps = options.save_every = 100;
   options.paths = PATHS;
   options.threads = 2;
   own_symsde_input_init(&input);
   input.q0 = input.p0 = &one;
   own_symsde_paths_init(&paths);
   paths.t = t;
   paths.q = q;
   paths.p = p;
   paths.status = status;
   paths.failed_step = failed_step;
   OK(own_symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   own_symsde_model_delete(&model);
   own_symsde_scheme_delete(&scheme);
   CHECK(dlclose(library) == 0);
   CHECK(dlopen(path, RTLD_NOW | RTLD_NOLOAD) != NULL); /* the library stays loaded */
}

int main(void) {
   setenv("OMP_WAIT_POLICY", "active", 1); /* waiting threads spin in the code of OpenMP, so unloading it would crash */
   for (int k = 0; k < 20; k++) {
      use(TEST_LIBRARY);
   }
   return close_report();
}
