/* SPDX-License-Identifier: BSD-3-Clause
 *
 * What control groups leave a process, of both versions, read from trees of files that are made here.
 */
#define _DEFAULT_SOURCE
#include "../../src/base/group_memory.c"

#include "check.h"

#include <sys/stat.h>
#include <unistd.h>

static char place[] = "groups-XXXXXX";
static char name[8192], list[4096];

static const char *in_place(const char *file) {
   snprintf(name, sizeof name, "%s/%s", place, file);
   return name;
}

static void put(const char *file, const char *text) {
   for (char *end = strchr(in_place(file) + strlen(place) + 1, '/'); end != NULL; end = strchr(end + 1, '/')) {
      *end = 0;
      mkdir(name, 0700);
      *end = '/';
   }
   FILE *stream = fopen(name, "w");
   CHECK(stream != NULL);
   if (stream != NULL) {
      fputs(text, stream);
      fclose(stream);
   }
}

static double left(const char *text, const char *root) {
   put("list", text);
   snprintf(list, sizeof list, "%s/list", place);
   return symsde_group_memory(list, in_place(root));
}

static void two(void) {
   CHECK(left("0::/\n", "two") == HUGE_VAL); /* the root group of a machine has no such files */
   put("two/job/memory.max", "max\n");
   CHECK(left("0::/job\n", "two") == HUGE_VAL);
   put("two/job/memory.max", "1000000000\n");
   CHECK(left("0::/job\n", "two") == 1e9);
   put("two/job/memory.current", "700000000\n");
   CHECK(left("0::/job\n", "two") == 3e8);
   put("two/job/memory.stat", "anon 1\nfile 9\nslab 7\ninactive_file 150000000\nactive_file 50000000\n");
   CHECK(left("0::/job\n", "two") == 5e8);
   /* The limit of a parent group counts. The limits of a child group, of a group whose name has the same beginning
    * (steps), and of another branch (other) do not. */
   put("two/job/step/memory.max", "max\n");
   CHECK(left("0::/job/step/task\n", "two") == 5e8);
   put("two/job/step/memory.max", "100000000\n");
   CHECK(left("0::/job/step\n", "two") == 1e8);
   CHECK(left("0::/job\n", "two") == 5e8);
   CHECK(left("0::/job/steps\n", "two") == 5e8);
   CHECK(left("0::/other\n", "two") == HUGE_VAL);
   /* more memory is used than allowed, as after a limit was lowered */
   put("two/job/step/memory.current", "200000000\n");
   CHECK(left("0::/job/step\n", "two") == 0);
   /* a container: its list of groups is the host's, or begins elsewhere */
   put("inside/memory.max", "250000000\n");
   CHECK(left("0::/system.slice/docker-1.scope\n", "inside") == 2.5e8);
   CHECK(left("0::/../../x\n", "inside") == 2.5e8);
   CHECK(left("0::/\n", "inside") == 2.5e8);
}

static void one_and_both(void) {
   put("one/memory/job/memory.limit_in_bytes", "9223372036854771712\n");
   CHECK(left("5:cpu:/job\n4:memory:/job\n0::/\n", "one") == HUGE_VAL);
   put("one/memory/job/memory.limit_in_bytes", "800000000\n");
   put("one/memory/job/memory.usage_in_bytes", "600000000\n");
   put("one/memory/job/memory.stat", "inactive_file 1\ntotal_inactive_file 100000000\ntotal_active_file 100000000\n");
   CHECK(left("5:cpu:/job\n4:memory:/job\n0::/\n", "one") == 4e8);
   CHECK(left("5:cpu:/job\n4:memory:/elsewhere\n", "one") == HUGE_VAL);
   CHECK(left("4:memory_pressure:/job\n3:name=memory:/job\n", "one") == HUGE_VAL);
   put("one/cpu,memory/job/memory.limit_in_bytes", "5000000\n");
   CHECK(left("2:cpu,memory:/job\n", "one") == 5e6);
   put("one/memory,cpu/job/memory.limit_in_bytes", "6000000\n");
   CHECK(left("2:memory,cpu:/job\n", "one") == 6e6);
   CHECK(left("nothing of the kind\n:\n::\n\n", "one") == HUGE_VAL);
   put("list", "");
   CHECK(symsde_group_memory(in_place("nowhere"), place) == HUGE_VAL);
}

/* Names that are longer than any that can be opened. */
static void long_names(void) {
   char text[6000];
   memset(text, 'x', sizeof text);
   memcpy(text, "0::/", 4);
   text[5999] = 0;
   CHECK(left(text, "inside") == HUGE_VAL);
   text[3000] = 0;
   CHECK(left(text, "inside") == 2.5e8);
}

int main(void) {
   if (mkdtemp(place) == NULL) {
      perror(place);
      return 1;
   }
   two();
   one_and_both();
   long_names();
   snprintf(list, sizeof list, "rm -r %s", place);
   CHECK(system(list) == 0);
   return close_report();
}
