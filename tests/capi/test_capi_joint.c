/* SPDX-License-Identifier: BSD-3-Clause
 *
 * What spares a user's model its second sine and cosine: symsde_model_set_gradient_hessian, symsde_sincos; third
 * derivatives, symsde_model_set_third_derivative; and products of noises that meet, symsde_model_set_squares.
 */
#include "run.h"

static arrays a;

/* the pendulum's functions, with counters; the model is used on one thread */
typedef struct counted_user {
   pendulum_user pendulum;
   double wrong_gradient;            /* error added by the joint function */
   int gradients, hessians, joints;  /* calls */
} counted_user;

static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *hq, double *hp, void *user) {
   ((counted_user *)user)->gradients++;
   return pendulum_gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user);
}

static int hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                   double *hqq, double *hqp, double *hpp, void *user) {
   counted_user *u = user;
   pendulum_user right = u->pendulum;
   right.wrong = 0; /* the separate functions are always right */
   u->hessians++;
   return pendulum_hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, &right);
}

static int joint(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *hq,
                 double *hp, double *hqq, double *hqp, double *hpp, void *user) {
   counted_user *u = user;
   u->joints++;
   if (pendulum_gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user) != 0) {
      return 19;
   }
   for (int i = 0; hq != NULL && i < nlane; i++) {
      hq[i] += u->wrong_gradient;
   }
   return pendulum_hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user);
}

static symsde_model new_counted(counted_user *user, symsde_hessian separate) {
   symsde_model model = NULL;
   const symsde_traits traits = pendulum_traits();
   OK(symsde_model_new("counted", &traits, gradient, NULL, separate, NULL, user, &model, &error));
   return model;
}

/* run on one thread, and count the calls beyond those of the probe */
static void run(symsde_model model, counted_user *user, const char *name, arrays *results) {
   symsde_scheme scheme = new_scheme(name);
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(results, 0);
   symsde_report report;

   symsde_report_init(&report);
   options.threads = 1;
   OK(symsde_model_probe(model, 2.0, &one, &zero, &error));
   user->gradients = -user->gradients; /* calls by the run's own probe are subtracted */
   user->hessians = -user->hessians;
   user->joints = -user->joints;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   symsde_scheme_delete(&scheme);
}

static void forget(counted_user *user) {
   user->gradients = user->hessians = user->joints = 0;
}

/* equal bits; a scheme that always needs gradient and Hessian together never calls the separate functions, but
 * warnings before a run need the Hessian alone */
static void test_joint_is_called(void) {
   static arrays separate, together, alone;
   const char *schemes[] = {"midpoint", "gauss2", "symplectic_euler"};
   counted_user user = {{0.3, INFINITY, 0.0}, 0.0, 0, 0, 0};
   symsde_model model = new_counted(&user, hessian), without = new_counted(&user, NULL);
   symsde_traits traits;
   int gradients;

   symsde_traits_init(&traits);
   OK(symsde_model_traits(without, &traits, &error));
   CHECK(traits.has_hessian == 0);
   for (int i = 0; i < 3; i++) {
      forget(&user);
      run(model, &user, schemes[i], &separate);
      gradients = user.gradients;
      CHECK(user.joints == 0 && user.gradients > 0 && (i == 2 || user.hessians > 0));
      OK(symsde_model_set_gradient_hessian(model, joint, &error));
      OK(symsde_model_set_gradient_hessian(without, joint, &error));
      forget(&user);
      run(model, &user, schemes[i], &together);
      CHECK(i == 2 ? user.joints <= 0 && user.gradients > 0 : user.joints > 0);
      CHECK(i == 2 || (user.hessians < 10 && user.gradients < gradients / 10));
      run(without, &user, schemes[i], &alone);
      CHECK(memcmp(separate.q, together.q, sizeof separate.q) == 0);
      CHECK(memcmp(separate.p, together.p, sizeof separate.p) == 0);
      CHECK(memcmp(separate.q, alone.q, sizeof separate.q) == 0);
      OK(symsde_model_traits(without, &traits, &error));
      CHECK(traits.has_hessian == 1);
      /* without a joint function the separate functions are called again */
      OK(symsde_model_set_gradient_hessian(model, NULL, &error));
      OK(symsde_model_set_gradient_hessian(without, NULL, &error));
   }
   OK(symsde_model_traits(without, &traits, &error));
   CHECK(traits.has_hessian == 0);
   symsde_model_delete(&model);
   symsde_model_delete(&without);
}

static void test_joint_fails(void) {
   counted_user user = {{0.3, 3.0, 0.0}, 0.0, 0, 0, 0};
   symsde_model model = new_counted(&user, hessian), kubo = new_kubo();
   symsde_scheme scheme = new_scheme("midpoint");
   const symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);
   symsde_paths paths = paths_in(&a, 0);
   symsde_report report;

   symsde_report_init(&report);
   OK(symsde_model_set_gradient_hessian(model, joint, &error));
   EXPECT(SYMSDE_CALLBACK_FAILED, "19", symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   CHECK(isnan(a.q[(NTIME - 1) * PATHS]) && a.q[0] == 1);
   user.pendulum.refuse_after = INFINITY;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error)); /* the model must be probed again */
   user.pendulum.wrong = 1;
   EXPECT(SYMSDE_FALSE_TRAIT, "counted|offers gradient_hessian, but by it d2H_0",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   user.pendulum.wrong = 0;
   user.wrong_gradient = 0.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "counted|offers gradient_hessian, but dH_0/dq_1",
          symsde_simulate(model, scheme, &options, &input, &paths, &report, &error));
   OK(symsde_model_set_gradient_hessian(model, NULL, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, &report, &error)); /* NULL: neither called nor probed */

   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_set_gradient_hessian(kubo, joint, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_set_gradient_hessian(NULL, joint, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
   symsde_scheme_delete(&scheme);
}

/* H = (p^2 + q^2)/2 + c q^3/3 - q^2 p, H_1 = s (q p^2/2 + q^3): cubic, so that the differences in nested brackets are exact */
typedef struct cubic_user {
   double c, s;
   double wrong; /* third derivatives are multiplied by 1 + this number */
   int asked;
} cubic_user;

static int cubic_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   const cubic_user *u = user;
   (void)t, (void)ndof, (void)nham;
   for (int i = 0; i < nlane; i++) {
      const double x = q[i], y = p[i], a = w[i], b = u->s * w[nlane + i];
      hq[i] = a * (x + u->c * x * x - 2 * x * y) + b * (y * y / 2 + 3 * x * x);
      hp[i] = a * (y - x * x) + b * x * y;
   }
   return 0;
}

static int cubic_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                         double *hqq, double *hqp, double *hpp, void *user) {
   const cubic_user *u = user;
   (void)t, (void)ndof, (void)nham;
   for (int i = 0; i < nlane; i++) {
      const double x = q[i], y = p[i], a = w[i], b = u->s * w[nlane + i];
      hqq[i] = a * (1 + 2 * u->c * x - 2 * y) + b * 6 * x;
      hqp[i] = -2 * a * x + b * y;
      hpp[i] = a + b * x;
   }
   return 0;
}

static int cubic_third(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                       const double *aq, const double *ap, const double *bq, const double *bp, double *uq, double *up,
                       void *user) {
   cubic_user *u = user;
   (void)t, (void)ndof, (void)nham, (void)q, (void)p;
   u->asked++;
   for (int i = 0; i < nlane; i++) {
      const double a = w[i] * (1 + u->wrong), b = u->s * w[nlane + i] * (1 + u->wrong);
      const double qqq = 2 * u->c * a + 6 * b, qqp = -2 * a, qpp = b, mixed = aq[i] * bp[i] + ap[i] * bq[i];
      uq[i] = qqq * aq[i] * bq[i] + qqp * mixed + qpp * ap[i] * bp[i];
      up[i] = qqp * aq[i] * bq[i] + qpp * mixed;
   }
   return 0;
}

/* the same paths by exact nested brackets and by differences; wrong third derivatives are refused */
static void test_third_derivative(void) {
   static arrays differences, exact;
   cubic_user user = {0.7, 0.2, 0, 0};
   symsde_model model = NULL, kubo = new_kubo();
   symsde_traits traits;
   symsde_scheme scheme = new_scheme("gauss2_strong32");
   symsde_options options = some_options();
   const double q0 = 0.3;
   const symsde_input input = some_input(&q0, &zero);
   symsde_paths paths = paths_in(&differences, 0);
   double largest = 0;

   symsde_traits_init(&traits);
   traits.ndof = traits.nnoise = 1;
   OK(symsde_model_new("cubic", &traits, cubic_gradient, NULL, cubic_hessian, NULL, &user, &model, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(user.asked == 0);
   OK(symsde_model_set_third_derivative(model, cubic_third, &error));
   paths = paths_in(&exact, 0);
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(user.asked > 10);
   for (int i = 0; i < NTIME * PATHS; i++) {
      largest = fmax(largest, fabs(differences.q[i] - exact.q[i]));
   }
   CHECK(largest > 0 && largest < 1e-11);
   user.wrong = 0.01;
   EXPECT(SYMSDE_FALSE_TRAIT, "cubic|offers third_derivative, but by it the third derivative of H_0",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_model_set_third_derivative(model, NULL, &error));
   user.asked = 0;
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(user.asked == 0);
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_set_third_derivative(kubo, cubic_third, &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
   symsde_scheme_delete(&scheme);
}

/* H = p^2/2 - cos q with five noises, H_k = s k cos(q + k) */
enum { MEETING = 5 };

typedef struct noisy_user {
   double s, wrong_g, wrong[6]; /* s and mistakes of g and of derivatives of sums */
   int asked, refused; /* calls, and the call that returns an error code */
} noisy_user;

static int noisy_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   const noisy_user *u = user;
   (void)t, (void)ndof;
   for (int i = 0; i < nlane; i++) {
      hq[i] = w[i] * sin(q[i]);
      hp[i] = w[i] * p[i];
      for (int k = 1; k < nham; k++) {
         hq[i] -= w[k * nlane + i] * u->s * k * sin(q[i] + k);
      }
   }
   return 0;
}

static int noisy_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                         double *hqq, double *hqp, double *hpp, void *user) {
   const noisy_user *u = user;
   (void)t, (void)ndof, (void)p;
   for (int i = 0; i < nlane; i++) {
      hqq[i] = w[i] * cos(q[i]);
      hqp[i] = 0;
      hpp[i] = w[i];
      for (int k = 1; k < nham; k++) {
         hqq[i] -= w[k * nlane + i] * u->s * k * cos(q[i] + k);
      }
   }
   return 0;
}

static int noisy_squares(int nlane, int ndof, int nham, double t, const double *q, double *g, const double *w,
                         const double *c, double *s, void *user) {
   noisy_user *u = user;
   (void)t, (void)ndof;
   u->asked++;
   for (int i = 0; i < nlane; i++) {
      double d[6] = {0};
      g[i] = u->wrong_g;
      for (int j = 1; j < nham; j++) {
         const double f = u->s * j, x = f * sin(q[i] + j), y = f * cos(q[i] + j);
         g[i] += x * y;
         if (s != NULL) {
            const double a = w[j * nlane + i], b = c[j * nlane + i];
            const double more[6] = {-a * x, -a * y, -b * x, -b * y, b * x, y * y - x * x};
            for (int k = 0; k < 6; k++) {
               d[k] += more[k];
            }
         }
      }
      if (s != NULL) {
         d[0] += w[i] * sin(q[i]);
         d[1] += w[i] * cos(q[i]);
         for (int k = 0; k < 6; k++) {
            s[k * nlane + i] = d[k] * (1 + u->wrong[k]);
         }
      }
   }
   return u->asked == u->refused ? 31 : 0;
}

/* the same paths by products of single noises and by all at one pass; wrong products are refused */
static void test_squares(void) {
   static arrays single, together;
   static const char *const schemes[] = {"chin4a", "gauss2_strong32"};
   noisy_user user = {0.1, 0, {0}, 0, 0};
   symsde_model model = NULL, other = NULL, kubo = new_kubo();
   symsde_traits traits;
   symsde_options options = some_options();
   const double q0 = 0.3;
   const symsde_input input = some_input(&q0, &zero);
   symsde_paths paths;

   symsde_traits_init(&traits);
   traits.ndof = 1;
   traits.nnoise = MEETING;
   traits.separable = traits.position_noise = 1;
   OK(symsde_model_new("noisy", &traits, noisy_gradient, NULL, noisy_hessian, NULL, &user, &other, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "noisy|identity_mass", symsde_model_set_squares(other, noisy_squares, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_set_squares(kubo, noisy_squares, &error));
   traits.identity_mass = 1;
   OK(symsde_model_new("noisy", &traits, noisy_gradient, NULL, noisy_hessian, NULL, &user, &model, &error));
   for (int j = 0; j < 2; j++) {
      symsde_scheme scheme = new_scheme(schemes[j]);
      double largest = 0;
      OK(symsde_model_set_squares(model, NULL, &error));
      paths = paths_in(&single, 0);
      user.asked = 0;
      OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
      CHECK(user.asked == 0);
      OK(symsde_model_set_squares(model, noisy_squares, &error));
      paths = paths_in(&together, 0);
      OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
      CHECK(user.asked > 10);
      for (int i = 0; i < NTIME * PATHS; i++) {
         largest = fmax(largest, fabs(single.q[i] - together.q[i]));
      }
      CHECK(largest < 1e-12 && fabs(single.q[NTIME * PATHS - 1] - q0) > 1e-3);
      user.wrong_g = 0.01;
      EXPECT(SYMSDE_FALSE_TRAIT, "noisy|squares of its noises|of g",
             symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
      user.wrong_g = 0;
      for (int k = 0; k < 6; k++) {
         static const char *const named[] = {"which S' is",  "which S'' is",  "which C' is",
                                             "which C'' is", "which C''' is", "which g' is"};
         user.wrong[k] = 0.01;
         EXPECT(SYMSDE_FALSE_TRAIT, named[k], symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
         user.wrong[k] = 0;
      }
      user.asked = 0;
      user.refused = 7;
      EXPECT(SYMSDE_CALLBACK_FAILED, "31", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
      user.refused = 0;
      symsde_scheme_delete(&scheme);
   }
   symsde_model_delete(&model);
   symsde_model_delete(&other);
   symsde_model_delete(&kubo);
}

/* calls in which an output is NULL, and calls with all outputs */
static int with_null, whole;

static void count(int nlane, double *outputs[], int n) {
   int missing = 0;
   for (int i = 0; i < n; i++) {
      missing += outputs[i] == NULL;
      for (int lane = 0; outputs[i] != NULL && lane < nlane; lane++) {
         outputs[i][lane] = 0;
      }
   }
   *(missing > 0 ? &with_null : &whole) += 1;
}

static int count_gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                          double *hq, double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)w, (void)q, (void)p, (void)user;
   count(nlane, (double *[]){hq, hp}, 2);
   return 0;
}

static int count_hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                         double *hqq, double *hqp, double *hpp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)w, (void)q, (void)p, (void)user;
   count(nlane, (double *[]){hqq, hqp, hpp}, 3);
   return 0;
}

static int count_joint(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                       double *hq, double *hp, double *hqq, double *hqp, double *hpp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)w, (void)q, (void)p, (void)user;
   count(nlane, (double *[]){hq, hp, hqq, hqp, hpp}, 5);
   return 0;
}

/* call the model, whose H is zero, for one output of each kind at a time */
static void ask_for_parts(symsde_model model) {
   const double w = 1;
   double hq = 7, hqq = 7, hqp = 7, hpp = 7;
   with_null = whole = 0;
   OK(symsde_model_gradient(model, 1, 0.0, &w, &one, &zero, &hq, NULL, &error));
   OK(symsde_model_gradient(model, 1, 0.0, &w, &one, &zero, NULL, &hq, &error));
   OK(symsde_model_hessian(model, 1, 0.0, &w, &one, &zero, &hqq, NULL, NULL, &error));
   OK(symsde_model_hessian(model, 1, 0.0, &w, &one, &zero, NULL, &hqp, NULL, &error));
   OK(symsde_model_hessian(model, 1, 0.0, &w, &one, &zero, NULL, NULL, &hpp, &error));
   CHECK(hq == 0 && hqq == 0 && hqp == 0 && hpp == 0);
}

/* outputs are NULL only for functions that accept NULL: other functions would write through the pointer */
static void test_null_is_not_handed_out(void) {
   symsde_model model = NULL, kubo = new_kubo();
   symsde_traits traits;
   symsde_traits_init(&traits);
   traits.ndof = 1;
   for (int alone = 0; alone < 2; alone++) {
      OK(symsde_model_new("zero", &traits, count_gradient, NULL, alone ? NULL : count_hessian, NULL, NULL, &model,
                          &error));
      OK(symsde_model_set_gradient_hessian(model, count_joint, &error));
      ask_for_parts(model);
      CHECK(with_null == 0 && whole == 5);
      OK(symsde_model_accept_null(model, &error));
      ask_for_parts(model);
      CHECK(with_null == 5 && whole == 0);
      symsde_model_delete(&model);
   }
   EXPECT(SYMSDE_INCOMPATIBLE, "kubo|symsde_model_new", symsde_model_accept_null(kubo, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model is NULL", symsde_model_accept_null(NULL, &error));
   symsde_model_delete(&kubo);
}

static void test_sincos(void) {
   enum { N = 1003 };
   static double x[N], sine[N + 1], cosine[N + 1];
   double single[2], worst = 0;

   for (int i = 0; i < N; i++) {
      x[i] = 0.37 * (i - 500);
   }
   x[7] = 1e9; /* beyond the range of the fast reduction */
   x[8] = NAN;
   sine[N] = cosine[N] = 3;
   CHECK(symsde_sincos(N, x, sine, cosine) == SYMSDE_OK);
   CHECK(isnan(sine[8]) && isnan(cosine[8]) && sine[N] == 3 && cosine[N] == 3);
   sine[8] = cosine[8] = x[8] = 0;
   cosine[8] = 1;
   for (int i = 0; i < N; i++) {
      worst = fmax(worst, fmax(fabs(sine[i] - sin(x[i])), fabs(cosine[i] - cos(x[i]))));
      CHECK(symsde_sincos(1, x + i, single, single + 1) == SYMSDE_OK);
      CHECK(single[0] == sine[i] && single[1] == cosine[i]); /* the bits do not depend on neighbours */
   }
   CHECK(worst < 3e-16);
   CHECK(symsde_sincos(0, x, sine, cosine) == SYMSDE_OK);
   CHECK(symsde_sincos(-1, x, sine, cosine) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_sincos(N, NULL, sine, cosine) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_sincos(N, x, NULL, cosine) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_sincos(N, x, sine, NULL) == SYMSDE_INVALID_ARGUMENT);
}

/* damped momenta: H = a (p^2 + q^2)/2 with small a, so p falls by exp(-gamma h) in every step, up to O(a h) */
static void test_damping(void) {
   const char *keys[] = {"a", "sigma"};
   const double values[] = {1e-9, 0}, rate = 0.5, several[] = {0.5, 0.5}, gain = -0.5, closed = 0, one = 1, zero = 0;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(&zero, &one);
   arrays a;
   symsde_paths paths = paths_in(&a, 0);

   OK(symsde_model_get("kubo", 2, keys, values, &model, &error));
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   OK(symsde_model_set_damping(model, 1, &rate, 0, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - exp(-rate * options.step * (double)options.steps)) < 1e-6);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "2 rates of damping for 1 degrees|give one rate, or one for each",
          symsde_model_set_damping(model, 2, several, 0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "negative|allow gain", symsde_model_set_damping(model, 1, &gain, 0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nrate = 0|give one rate", symsde_model_set_damping(model, 0, &rate, 0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "rates", symsde_model_set_damping(model, 1, NULL, 0, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_set_damping(NULL, 1, &rate, 0, &error));
   /* a refused set of rates leaves the old ones */
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - exp(-rate * options.step * (double)options.steps)) < 1e-6);
   OK(symsde_model_set_damping(model, 1, &gain, 1, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(a.p[(NTIME - 1) * PATHS] > 1);
   OK(symsde_model_set_damping(model, 1, &closed, 0, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - 1) < 1e-6);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* friction on velocities by a matrix, which is a rate where there is one degree of freedom of mass one */
static void test_friction(void) {
   const double rate = 0.5, negative = -0.5, none = 0, lopsided[] = {1, 0.5, 0.25, 1}, one = 1, zero = 0;
   symsde_model model = NULL, pair = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(&zero, &one);
   arrays a, b;
   symsde_paths paths = paths_in(&a, 0), others = paths_in(&b, 0);
   const int last = (NTIME - 1) * PATHS;

   OK(symsde_model_get("linear_oscillator", 0, NULL, NULL, &model, &error));
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   OK(symsde_model_set_damping(model, 1, &rate, 0, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_model_set_friction(model, &rate, 0, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &others, NULL, &error));
   CHECK(fabs(a.p[last] - b.p[last]) < 1e-12 && fabs(a.q[last] - b.q[last]) < 1e-12);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "negative eigenvalue|allow gain",
          symsde_model_set_friction(model, &negative, 0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "friction", symsde_model_set_friction(model, NULL, 0, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_set_friction(NULL, &rate, 0, &error));
   OK(symsde_model_get("henon_heiles", 0, NULL, NULL, &pair, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "not symmetric", symsde_model_set_friction(pair, lopsided, 0, &error));
   OK(symsde_model_set_friction(model, &negative, 1, &error));
   OK(symsde_model_set_friction(model, &none, 0, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &others, NULL, &error));
   CHECK(fabs(a.p[last] - b.p[last]) > 1e-6);
   symsde_model_delete(&model);
   symsde_model_delete(&pair);
   symsde_scheme_delete(&scheme);
}

/* H = |p - A|^2/2 with A = (-y, x), a field of strength two, and the force that goes with it */
static int field(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *hq,
                 double *hp, void *user) {
   (void)ndof, (void)nham, (void)t, (void)user;
   for (int i = 0; i < nlane; i++) {
      const double u = p[i] + q[nlane + i], v = p[nlane + i] - q[i];
      if (hq)
         hq[i] = -w[i] * v, hq[nlane + i] = w[i] * u;
      if (hp)
         hp[i] = w[i] * u, hp[nlane + i] = w[i] * v;
   }
   return 0;
}

/* a quadratic part is a whole turn after the time pi, whatever the step is; a wrong one is refused */
static void test_quadratic_part(void) {
   const double second[4][4] = {{1, 0, 0, -1}, {0, 1, 1, 0}, {0, 1, 1, 0}, {-1, 0, 0, 1}};
   const double lopsided[4][4] = {{1, 1, 0, -1}, {0, 1, 1, 0}, {0, 1, 1, 0}, {-1, 0, 0, 1}};
   const double wrong[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
   const double q0[] = {1, 0.5}, p0[] = {0.25, -1};
   double q[2 * NTIME * PATHS * 2], p[2 * NTIME * PATHS * 2];
   symsde_model model = NULL, kubo = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(q0, p0);
   arrays a;
   symsde_paths paths = paths_in(&a, 0);
   symsde_traits traits;

   symsde_traits_init(&traits);
   traits.ndof = 2;
   OK(symsde_model_new("field", &traits, field, NULL, NULL, NULL, NULL, &model, &error));
   OK(symsde_scheme_get("gauss_dkdkd", &scheme, &error));
   paths.q = q, paths.p = p;
   options.step = 3.14159265358979323846 / (NTIME - 1);
   options.steps = NTIME - 1;
   options.save_every = 1;
   EXPECT(SYMSDE_INCOMPATIBLE, "split", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "not symmetric", symsde_model_set_quadratic_part(model, &lopsided[0][0], &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_set_quadratic_part(NULL, &second[0][0], &error));
   OK(symsde_model_set_quadratic_part(model, &wrong[0][0], &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "quadratic part", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_model_set_quadratic_part(model, &second[0][0], &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   for (int k = 0; k < 2; k++)
      for (int i = 0; i < PATHS; i++) {
         const int last = ((NTIME - 1) * 2 + k) * PATHS + i;
         CHECK(fabs(q[last] - q0[k]) < 1e-13 && fabs(p[last] - p0[k]) < 1e-13);
      }
   OK(symsde_model_set_quadratic_part(model, NULL, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "split", symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_model_get("kubo", 0, NULL, NULL, &kubo, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "built in", symsde_model_set_quadratic_part(kubo, &second[0][0], &error));
   symsde_model_delete(&model);
   symsde_model_delete(&kubo);
   symsde_scheme_delete(&scheme);
}

/* a bath: a noise after the model's noises, with sigma^2 = 2 gamma m/beta, and the friction; callbacks keep their
 * failures */
static void test_thermostat(void) {
   const char *keys[] = {"a", "sigma"};
   const double values[] = {4, 0}, gamma = 0.5, beta = 2, several[] = {0.5, 0.5}, wrong = -1, one = 1;
   const double w[] = {0, 0, 1};
   double hq = 0, hp = 1;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &one);
   arrays a;
   symsde_paths paths = paths_in(&a, 0);
   symsde_traits traits = {0};

   traits.struct_size = sizeof traits;
   OK(symsde_model_get("kubo", 2, keys, values, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "2 rates", symsde_model_thermostat(model, 2, several, 1, &beta, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "2 values of beta", symsde_model_thermostat(model, 1, &gamma, 2, several, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "beta is not a finite",
          symsde_model_thermostat(model, 1, &gamma, 1, &wrong, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "negative", symsde_model_thermostat(model, 1, &wrong, 1, &beta, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nbeta = 0", symsde_model_thermostat(model, 1, &gamma, 0, &beta, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "gamma", symsde_model_thermostat(model, 1, NULL, 1, &beta, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_thermostat(NULL, 1, &gamma, 1, &beta, &error));
   OK(symsde_model_traits(model, &traits, &error)); /* refused baths leave the model as it was */
   CHECK(traits.nnoise == 1);
   OK(symsde_model_thermostat(model, 1, &gamma, 1, &beta, &error));
   OK(symsde_model_traits(model, &traits, &error));
   CHECK(traits.nnoise == 2 && traits.silent[0] && !traits.silent[1]);
   OK(symsde_model_gradient(model, 1, 0, w, &one, &one, &hq, &hp, &error));
   CHECK(fabs(hq + sqrt(2 * gamma / 4 / beta)) < 1e-15 && fabs(hp) <= 0);
   EXPECT(SYMSDE_INCOMPATIBLE, "damped already", symsde_model_thermostat(model, 1, &gamma, 1, &beta, &error));
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

static int count_of_derivatives = 0;

/* F = -2 p with the weight of H, or f_1 = q with the weight of the noise */
static int drag(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p, double *f,
                void *user) {
   (void)t, (void)q, (void)nham;
   for (int i = 0; i < ndof * nlane; i++)
      f[i] = -2 * w[i % nlane] * p[i];
   return *(int *)user;
}

static int drag_derivative(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                           double *fq, double *fp, void *user) {
   (void)t, (void)q, (void)p, (void)nham, (void)user;
   count_of_derivatives++;
   for (int j = 0; j < ndof; j++)
      for (int i = 0; i < ndof; i++)
         for (int lane = 0; lane < nlane; lane++) {
            fq[(j * ndof + i) * nlane + lane] = 0;
            fp[(j * ndof + i) * nlane + lane] = i == j ? -2 * w[lane] : 0;
         }
   return 0;
}

static int noise_pull(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                      double *f, void *user) {
   (void)t, (void)p, (void)nham, (void)user;
   for (int i = 0; i < ndof * nlane; i++)
      f[i] = w[nlane + i % nlane] * q[i];
   return 0;
}

/* forces on H = a (p^2 + q^2)/2 with a small: p falls by (1 - h)/(1 + h) in every step of the midpoint rule */
static void test_forces(void) {
   const char *keys[] = {"a", "sigma"};
   const double values[] = {1e-9, 0}, one = 1, zero = 0;
   int fine = 0, refuses = 7;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(&zero, &one);
   arrays a;
   symsde_paths paths = paths_in(&a, 0);
   const double h = options.step;

   OK(symsde_model_get("kubo", 2, keys, values, &model, &error));
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   OK(symsde_model_set_force(model, drag, drag_derivative, 0, &fine, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - pow((1 - h) / (1 + h), (double)options.steps)) < 1e-6);
   CHECK(count_of_derivatives > 0);
   OK(symsde_model_set_force(model, drag, NULL, 0, &fine, &error)); /* by differences */
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - pow((1 - h) / (1 + h), (double)options.steps)) < 1e-6);
   OK(symsde_model_set_noise_force(model, noise_pull, NULL, 1, NULL, &error));
   OK(symsde_model_set_force_bandwidth(model, 0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "give 0 or more", symsde_model_set_force_bandwidth(model, -2, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_model_set_force(model, drag, NULL, 1, &fine, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "F depends on q and t alone|say that it does",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "derivative without a force",
          symsde_model_set_force(model, NULL, drag_derivative, 0, &fine, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_set_force(NULL, drag, NULL, 0, &fine, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model", symsde_model_set_noise_force(NULL, drag, NULL, 0, &fine, &error));
   OK(symsde_model_set_force(model, drag, NULL, 0, &refuses, &error)); /* a built-in model keeps no code: paths fail */
   CHECK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error) != SYMSDE_OK);
   OK(symsde_model_set_force(model, NULL, NULL, 0, NULL, &error));
   OK(symsde_model_set_noise_force(model, NULL, NULL, 0, NULL, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - 1) < 1e-6);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

/* gamma = (1 + t)/10, or 2 q^2 - 1 */
static int in_time(int nlane, int ndof, int nrate, double t, const double *q, double *rate, void *user) {
   (void)q, (void)ndof, (void)nrate;
   for (int lane = 0; lane < nlane; lane++)
      rate[lane] = 0.1 * (1 + t);
   return *(int *)user;
}

static int in_position(int nlane, int ndof, int nrate, double t, const double *q, double *rate, void *user) {
   (void)t, (void)nrate, (void)user;
   for (int i = 0; i < ndof * nlane; i++)
      rate[i] = 2 * q[i] * q[i] - 1;
   return 0;
}

/* rates that are functions: p falls by exp(-int gamma dt), by every scheme, if H hardly changes p */
static void test_damping_function(void) {
   const char *keys[] = {"a", "sigma"};
   const double values[] = {1e-14, 0}, one = 1, zero = 0;
   int fine = 0, refuses = 7;
   symsde_model model = NULL;
   symsde_scheme scheme = NULL;
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &one);
   const symsde_input origin = some_input(&zero, &one);
   arrays a;
   symsde_paths paths = paths_in(&a, 0);
   const double h = options.step, t = h * (double)options.steps;

   OK(symsde_model_get("kubo", 2, keys, values, &model, &error));
   OK(symsde_scheme_get("gauss2", &scheme, &error));
   OK(symsde_model_set_damping_function(model, in_time, 1, SYMSDE_ON_TIME, 0, &fine, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] / exp(-0.1 * t * (1 + options.t0) - 0.05 * t * t) - 1) < 1e-6);
   OK(symsde_model_set_damping_function(model, in_position, 1, SYMSDE_ON_POSITION, 0, NULL, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] / exp(-t) - 1) < 1e-6);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "negative rate|allow gain",
          symsde_simulate(model, scheme, &options, &origin, &paths, NULL, &error));
   OK(symsde_model_set_damping_function(model, in_position, 1, SYMSDE_ON_POSITION, 1, NULL, &error));
   OK(symsde_simulate(model, scheme, &options, &origin, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] / exp(t) - 1) < 1e-6);
   OK(symsde_model_set_damping_function(model, in_time, 1, SYMSDE_ON_POSITION, 0, &fine, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "depends on position alone",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   OK(symsde_model_set_damping_function(model, in_position, 1, SYMSDE_ON_TIME, 0, NULL, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "depends on time alone",
          symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nrate = 2",
          symsde_model_set_damping_function(model, in_time, 2, SYMSDE_ON_TIME, 0, &fine, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "depends = 0",
          symsde_model_set_damping_function(model, in_time, 1, 0, 0, &fine, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "depends = 4",
          symsde_model_set_damping_function(model, in_time, 1, 4, 0, &fine, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "model",
          symsde_model_set_damping_function(NULL, in_time, 1, SYMSDE_ON_TIME, 0, &fine, &error));
   OK(symsde_model_set_damping_function(model, in_time, 1, SYMSDE_ON_TIME, 0, &refuses, &error)); /* paths fail */
   CHECK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error) != SYMSDE_OK);
   OK(symsde_model_set_damping_function(model, NULL, 1, SYMSDE_ON_TIME, 0, NULL, &error));
   OK(symsde_simulate(model, scheme, &options, &input, &paths, NULL, &error));
   CHECK(fabs(a.p[(NTIME - 1) * PATHS] - 1) < 1e-6);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

int main(void) {
   test_joint_is_called();
   test_joint_fails();
   test_third_derivative();
   test_squares();
   test_null_is_not_handed_out();
   test_sincos();
   test_damping();
   test_friction();
   test_quadratic_part();
   test_thermostat();
   test_forces();
   test_damping_function();
   return close_report();
}
