/* SPDX-License-Identifier: BSD-3-Clause
 * A stranger's program: the installed header and library, nothing else of the project. */
#include <symsde.h>

#include <stdio.h>

int main(void) {
   char version[64];
   const char *keys[] = {"sigma"};
   const double values[] = {0.3};
   symsde_model model = NULL;
   symsde_error error;

   if (symsde_version(version, sizeof version, NULL) != SYMSDE_OK)
      return 1;
   if (symsde_model_get("kubo", 1, keys, values, &model, &error) != SYMSDE_OK) {
      fprintf(stderr, "%s\n", error.message);
      return 1;
   }
   if (symsde_model_delete(&model) != SYMSDE_OK || model != NULL)
      return 1;
   printf("C: symsde %s\n", version);
   return 0;
}
