/* SPDX-License-Identifier: BSD-3-Clause
 *
 * A process that has run on two threads forks: the child asks for two threads too. OpenMP's threads are not there, and
 * it must not wait for them; what it computes is what its parent computed.
 */
#define _POSIX_C_SOURCE 200809L
#include "run.h"

#include <sys/wait.h>
#include <unistd.h>

static arrays parent, child;

static int run_on_two(arrays *into) {
   symsde_model model = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(into, 0);
   symsde_report report;

   symsde_report_init(&report);
   options.threads = 2;
   options.lanes = 8;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return report.threads;
}

int main(void) {
   int status = -1;

   CHECK(run_on_two(&parent) == 2);
   fflush(stdout);
   const pid_t forked = fork();
   if (forked == 0) {
      alarm(600); /* SIGALRM ends a child that hangs */
      CHECK(run_on_two(&child) == 1);
      CHECK(memcmp(child.q, parent.q, sizeof(double) * NTIME * PATHS) == 0);
      fflush(stdout);
      _exit(failed > 0);
   }
   CHECK(forked > 0 && waitpid(forked, &status, 0) == forked);
   CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
   CHECK(run_on_two(&parent) == 2);
   return close_report();
}
