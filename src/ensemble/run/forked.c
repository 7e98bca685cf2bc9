/* SPDX-License-Identifier: BSD-3-Clause
 * Whether this process is a fork of the one that loaded the library. The threads of OpenMP do not come along into such a
 * child, but its record of them does: a second parallel region would wait for them for ever. So a forked child computes
 * on one thread, whatever its parent did before; results do not depend on that. */
#define _POSIX_C_SOURCE 200809L
#include <unistd.h>

__attribute__((visibility("hidden"))) int process_is_forked(void);

static pid_t loading_process; /* written once, before any other function of the library can be called */

__attribute__((constructor)) static void remember_process(void) {
   loading_process = getpid();
}

int process_is_forked(void) {
   return getpid() != loading_process;
}
