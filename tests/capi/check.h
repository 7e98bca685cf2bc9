/* SPDX-License-Identifier: BSD-3-Clause
 *
 * What the test programs share: counted checks, a model whose functions are its own, the closing line.
 */
#ifndef SYMSDE_TEST_CHECK_H
#define SYMSDE_TEST_CHECK_H

#include "symsde.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* counted for each thread */
static _Thread_local int passed, failed;

#define CHECK(condition) check((condition), #condition, __FILE__, __LINE__)
/* the status of a call, and words that its message must hold, separated by '|' */
#define EXPECT(wanted, words, call) expect((wanted), (words), (call), #call, __FILE__, __LINE__)
#define OK(call) EXPECT(SYMSDE_OK, "", call)

static _Thread_local symsde_error error;

static inline void check(int condition, const char *text, const char *file, int line) {
   if (condition) {
      passed++;
   } else {
      failed++;
      printf("%s:%d: failed: %s\n", file, line, text);
   }
}

static inline int holds(const char *message, const char *words) {
   while (*words != 0) {
      char word[256];
      const size_t size = strcspn(words, "|");
      snprintf(word, sizeof word, "%.*s", (int)size, words);
      if (strstr(message, word) == NULL) {
         return 0;
      }
      words += size + (words[size] == '|');
   }
   return 1;
}

static inline void expect(int wanted, const char *words, int status, const char *text, const char *file, int line) {
   const int good = status == wanted && error.code == wanted && holds(error.message, words) &&
                    (wanted == SYMSDE_OK || error.message[0] != 0);
   check(good, text, file, line);
   if (!good) {
      printf("   status %d, code %d, wanted %d and \"%s\": %s\n", status, (int)error.code, wanted, words,
             error.message);
   }
}

static inline int close_report(void) {
   printf("%d passed, %d failed\n", passed, failed);
   return failed > 0;
}

/* The user's model: a pendulum with noise in the position, H = p^2/2 - cos q, H_1 = sigma sin q. `user` has the time
 * from which callbacks return an error. */
typedef struct pendulum_user {
   double sigma;
   double refuse_after; /* from this time on callbacks return the error code 17 */
   double wrong;        /* added to the Hessian */
} pendulum_user;

static inline int pendulum_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                    const double *p, double *hq, double *hp, void *user) {
   const pendulum_user *u = user;
   if (ndof != 1 || nham != 2 || t > u->refuse_after) {
      return 17;
   }
   for (int i = 0; i < nlane; i++) {
      if (hq != NULL) {
         hq[i] = w[i] * sin(q[i]) + w[nlane + i] * u->sigma * cos(q[i]);
      }
      if (hp != NULL) {
         hp[i] = w[i] * p[i];
      }
   }
   return 0;
}

static inline int pendulum_value(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                 const double *p, double *value, void *user) {
   const pendulum_user *u = user;
   if (ndof != 1 || nham != 2 || t > u->refuse_after) {
      return 17;
   }
   for (int i = 0; i < nlane; i++) {
      value[i] = w[i] * (0.5 * p[i] * p[i] - cos(q[i])) + w[nlane + i] * u->sigma * sin(q[i]);
   }
   return 0;
}

static inline int pendulum_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                   const double *p, double *hqq, double *hqp, double *hpp, void *user) {
   const pendulum_user *u = user;
   (void)p;
   if (ndof != 1 || nham != 2 || t > u->refuse_after) {
      return 17;
   }
   for (int i = 0; i < nlane; i++) {
      if (hqq != NULL) {
         hqq[i] = w[i] * cos(q[i]) - w[nlane + i] * u->sigma * sin(q[i]) + u->wrong;
      }
      if (hqp != NULL) {
         hqp[i] = 0;
      }
      if (hpp != NULL) {
         hpp[i] = w[i];
      }
   }
   return 0;
}

static inline int pendulum_product(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                   const double *p, const double *vq, const double *vp, double *uq, double *up,
                                   void *user) {
   const pendulum_user *u = user;
   (void)p;
   if (ndof != 1 || nham != 2 || t > u->refuse_after) {
      return 17;
   }
   for (int i = 0; i < nlane; i++) {
      uq[i] = (w[i] * cos(q[i]) - w[nlane + i] * u->sigma * sin(q[i])) * vq[i];
      up[i] = w[i] * vp[i];
   }
   return 0;
}

static inline symsde_traits pendulum_traits(void) {
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = 1;
   traits.nnoise = 1;
   traits.separable = 1;
   traits.position_noise = 1;
   traits.identity_mass = 1;
   return traits;
}

static inline symsde_model new_pendulum(pendulum_user *user) {
   symsde_model model = NULL;
   const symsde_traits traits = pendulum_traits();
   OK(symsde_model_new("own pendulum", &traits, pendulum_gradient, pendulum_value, pendulum_hessian, pendulum_product,
                       user, &model, &error));
   return model;
}

static inline symsde_scheme new_scheme(const char *name) {
   symsde_scheme scheme = NULL;
   OK(symsde_scheme_get(name, &scheme, &error));
   return scheme;
}

#endif
