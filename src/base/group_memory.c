/* SPDX-License-Identifier: BSD-3-Clause
 * Memory that the control groups of this process leave it: a batch system, a container or a service sets limits there, and
 * who goes beyond is killed, where a limit of the process refuses. The kernel takes back what it keeps of files, so that
 * does not count as used. */
#define _DEFAULT_SOURCE
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LINE = 4096 };

/* Names of the files of control groups, version 1 (if its memory hierarchy is mounted) and version 2. */
typedef struct names {
   const char *limit, *used, *stat[2];
} names;

static const names version_1 = {
    "memory.limit_in_bytes", "memory.usage_in_bytes", {"total_inactive_file ", "total_active_file "}};
static const names version_2 = {"memory.max", "memory.current", {"inactive_file ", "active_file "}};

/* The number after `key` at the beginning of a line of a file; `otherwise` if there is none, as for "max". */
static double number_in(const char *folder, const char *file, const char *key, double otherwise) {
   char line[LINE + 64];
   if (snprintf(line, sizeof line, "%s/%s", folder, file) >= (int)sizeof line)
      return otherwise;
   FILE *stream = fopen(line, "re");
   if (stream == NULL)
      return otherwise;
   double found = otherwise;
   while (fgets(line, sizeof line, stream) != NULL) {
      if (strncmp(line, key, strlen(key)) != 0)
         continue;
      char *end;
      const unsigned long long number = strtoull(line + strlen(key), &end, 10);
      if (end != line + strlen(key))
         found = (double)number;
      break;
   }
   fclose(stream);
   return found;
}

/* Bytes that one group leaves. */
static double left_in(const char *folder, const names *names) {
   const double limit = number_in(folder, names->limit, "", HUGE_VAL);
   if (!(limit < 1e18)) /* version 1 writes 2^63 less a page if there is no limit */
      return HUGE_VAL;
   double used = number_in(folder, names->used, "", 0);
   for (int i = 0; i < 2; i++)
      used -= number_in(folder, "memory.stat", names->stat[i], 0);
   return fmax(0, limit - fmax(0, used));
}

/* 1 if a list of controllers, such as "cpu,memory", contains memory. */
static int has_memory(const char *controllers) {
   const char *found = strstr(controllers, "memory");
   return found != NULL && (found == controllers || found[-1] == ',') && (found[6] == 0 || found[6] == ',');
}

/* The least number of bytes left by the groups named in `list` (/proc/self/cgroup) and all groups above them, below
 * `root` (/sys/fs/cgroup); infinity without limits. A container may see another part of the tree than the list
 * names: missing groups are skipped, and the root counts as its group. */
__attribute__((visibility("hidden"))) double symsde_group_memory(const char *list, const char *root);
double symsde_group_memory(const char *list, const char *root) {
   double least = HUGE_VAL;
   char line[LINE], folder[LINE];
   FILE *stream = fopen(list, "re");
   if (stream == NULL)
      return least;
   while (fgets(line, sizeof line, stream) != NULL) {
      char *controllers = strchr(line, ':');
      char *path = controllers == NULL ? NULL : strchr(controllers + 1, ':');
      if (path == NULL)
         continue;
      *path++ = 0;
      path[strcspn(path, "\n")] = 0;
      const int is_version_2 = *++controllers == 0;
      if (!is_version_2 && !has_memory(controllers))
         continue;
      const int top = snprintf(folder, sizeof folder, "%s/%s", root, controllers) - is_version_2;
      if (top + strlen(path) >= sizeof folder)
         continue;
      strcpy(folder + top, path);
      for (char *end = folder + strlen(folder); end != NULL && end >= folder + top; end = strrchr(folder, '/')) {
         *end = 0;
         least = fmin(least, left_in(folder, is_version_2 ? &version_2 : &version_1));
      }
   }
   fclose(stream);
   return least;
}

/* The least number of bytes left by the groups of this process. */
__attribute__((visibility("hidden"))) double symsde_groups_leave(void);
double symsde_groups_leave(void) {
   return symsde_group_memory("/proc/self/cgroup", "/sys/fs/cgroup");
}
