/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Texts, models and schemes of the C interface: what they return, and every refusal by its words.
 */
#include "check.h"

static void test_texts(void) {
   char buffer[4096], small[4] = "xxx";
   size_t needed = 0;

   CHECK(symsde_status_text(SYMSDE_NOT_CONVERGED, buffer, sizeof buffer, &needed) == 0);
   CHECK(strcmp(buffer, "implicit equations not solved") == 0 && needed == strlen(buffer) + 1);
   CHECK(symsde_status_text(SYMSDE_OK, small, sizeof small, NULL) == 0 && strcmp(small, "ok") == 0);
   CHECK(symsde_status_text(SYMSDE_STOPPED, small, sizeof small, &needed) == 0);
   CHECK(strcmp(small, "sto") == 0 && needed == strlen("stopped on request") + 1);
   CHECK(symsde_status_text(SYMSDE_OK, small, 1, NULL) == 0 && small[0] == 0 && small[1] == 't');
   CHECK(symsde_status_text(SYMSDE_OK, NULL, 0, &needed) == 0 && needed == 3);
   CHECK(symsde_status_text(SYMSDE_OK, buffer, SIZE_MAX, NULL) == 0 && strcmp(buffer, "ok") == 0);
   CHECK(symsde_status_text(12345, buffer, sizeof buffer, NULL) == 0 && strstr(buffer, "unknown") != NULL);
   CHECK(symsde_version(buffer, sizeof buffer, &needed) == 0);
   CHECK(strcmp(buffer, TEST_VERSION) == 0 && needed == strlen(buffer) + 1);
   CHECK(symsde_build_info(buffer, sizeof buffer, NULL) == 0);
   CHECK(holds(buffer, "version: " TEST_VERSION "\n|compiler: |compile options: |-ffp-contract|openmp: yes\n") ||
         holds(buffer, "version: " TEST_VERSION "\n|compiler: |compile options: |-O|openmp: yes\n"));
   CHECK(strstr(buffer, "counter map of the noise: 2\n") != NULL);
   CHECK(strchr(buffer, '/') == NULL); /* messages hold no folder of the machine that built the library */
   CHECK(symsde_model_names(buffer, sizeof buffer, &needed) == 0);
   CHECK(holds(buffer, "kubo\n|linear_oscillator\n|synchrotron\n|additive_oscillator\n|pendulum\n|driven_pendulum\n") &&
         holds(buffer, "noncommutative_oscillator\n|henon_heiles\n|fpu_chain\n") && needed == strlen(buffer) + 1);
   CHECK(symsde_scheme_names(buffer, sizeof buffer, NULL) == 0);
   CHECK(holds(buffer, "midpoint\n|symplectic_euler\n|symplectic_euler_adjoint\n|stormer_verlet\n|gauss2\n"));
}

static void test_inits(void) {
   symsde_traits traits;
   symsde_scheme_info info;
   symsde_options options;
   symsde_input input;
   symsde_report report;
   symsde_paths paths;
   symsde_moments *moments = malloc(sizeof *moments);

   CHECK(symsde_traits_init(&traits) == 0 && traits.struct_size == sizeof traits);
   CHECK(traits.ndof == 1 && traits.nnoise == 0 && traits.bandwidth == -1 && traits.separable == 0);
   CHECK(symsde_scheme_info_init(&info) == 0 && info.struct_size == sizeof info && info.name[0] == 0);
   CHECK(symsde_options_init(&options) == 0 && options.struct_size == sizeof options);
   CHECK(options.step == 0 && options.steps == 0 && options.paths == 1 && options.save_every == 1);
   CHECK(options.seed == 0 && options.correction == SYMSDE_CORRECTION_AUTO && options.max_iter == 100);
   CHECK(options.areas == SYMSDE_AREAS_PATH && options.area_time == 0 && options.common_noise == 0);
   CHECK(options.damping_noise == SYMSDE_DAMPING_NOISE_LAW);
   CHECK(options.compensated == 0 && options.lanes == 0 && options.threads == 0 && options.refine == 0);
   CHECK(symsde_input_init(&input) == 0 && input.struct_size == sizeof input);
   CHECK(input.q0 == NULL && input.q0_paths == 1 && input.increments == NULL && input.increment_strides == NULL);
   CHECK(symsde_report_init(&report) == 0 && report.struct_size == sizeof report && report.stepper[0] == 0);
   CHECK(symsde_paths_init(&paths) == 0 && paths.struct_size == sizeof paths && paths.p_low == NULL);
   CHECK(symsde_moments_init(moments) == 0 && moments->struct_size == sizeof *moments);
   CHECK(moments->nobservable == 0 && moments->observables == NULL && moments->nfailed_listed == 0);
   CHECK(symsde_traits_init(NULL) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_scheme_info_init(NULL) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_options_init(NULL) == SYMSDE_INVALID_ARGUMENT && symsde_input_init(NULL) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_report_init(NULL) == SYMSDE_INVALID_ARGUMENT && symsde_paths_init(NULL) == SYMSDE_INVALID_ARGUMENT);
   CHECK(symsde_moments_init(NULL) == SYMSDE_INVALID_ARGUMENT);
   free(moments);
}

static void test_builtin_models(void) {
   const char *keys[] = {"sigma", "a"}, *unknown[] = {"sgima"}, *twice[] = {"a", "a"}, *none[] = {NULL};
   const double values[] = {0.5, 2.0}, nan_value[] = {NAN};
   char buffer[1024];
   symsde_model model = NULL;
   symsde_traits traits;
   size_t needed;

   OK(symsde_model_parameters("kubo", buffer, sizeof buffer, &needed, &error));
   CHECK(holds(buffer, "a = 1.0|sigma = |.2999") && needed == strlen(buffer) + 1); /* 0.3 with all its digits */
   EXPECT(SYMSDE_UNKNOWN_NAME, "cubo|kubo", symsde_model_parameters("cubo", buffer, sizeof buffer, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "name is NULL", symsde_model_parameters(NULL, buffer, 9, NULL, &error));

   OK(symsde_model_get("kubo", 2, keys, values, &model, &error));
   symsde_traits_init(&traits);
   OK(symsde_model_traits(model, &traits, &error));
   CHECK(traits.ndof == 1 && traits.nnoise == 1 && traits.quadratic == 1 && traits.has_value == 1);
   CHECK(traits.max_frequency == 2.0 && traits.noise_lipschitz == 0.5 && traits.identity_mass == 0);
   CHECK(symsde_model_delete(&model) == 0 && model == NULL && symsde_model_delete(&model) == 0);
   OK(symsde_model_get("fpu_chain", 0, NULL, NULL, &model, &error));
   CHECK(symsde_model_delete(&model) == 0 && symsde_model_delete(NULL) == 0);

   EXPECT(SYMSDE_UNKNOWN_NAME, "kubbo|kubo", symsde_model_get("kubbo", 0, NULL, NULL, &model, &error));
   CHECK(model == NULL);
   EXPECT(SYMSDE_UNKNOWN_NAME, "sgima|sigma", symsde_model_get("kubo", 1, unknown, values, &model, &error));
   EXPECT(SYMSDE_UNKNOWN_NAME, "no name is that long",
          symsde_model_get("kubo", 1, (const char *[]){"a_key_that_is_longer_than_every_name_there_is"}, values, &model,
                           &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "twice", symsde_model_get("kubo", 2, twice, values, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "a|finite", symsde_model_get("kubo", 1, twice, nan_value, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "keys is NULL: give its address",
          symsde_model_get("kubo", 1, NULL, values, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "key 1 is NULL", symsde_model_get("kubo", 1, none, values, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "values is NULL: give its address",
          symsde_model_get("kubo", 1, keys, NULL, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nparameter|negative", symsde_model_get("kubo", -1, keys, values, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "name is NULL", symsde_model_get(NULL, 0, NULL, NULL, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "model is NULL", symsde_model_get("kubo", 0, NULL, NULL, NULL, &error));
   /* the pointer to the error may be NULL */
   CHECK(symsde_model_get("kubbo", 0, NULL, NULL, &model, NULL) == SYMSDE_UNKNOWN_NAME);
}

static void test_own_model(void) {
   pendulum_user user = {0.3, INFINITY, 0.0};
   const double q0 = 0.4, p0 = -0.2;
   symsde_model model = new_pendulum(&user);
   symsde_traits traits = pendulum_traits(), got;

   symsde_traits_init(&got);
   OK(symsde_model_traits(model, &got, &error));
   CHECK(got.has_value == 1 && got.has_hessian == 1 && got.has_hessian_vector == 1 && got.position_noise == 1);
   OK(symsde_model_probe(model, 0.0, &q0, &p0, &error));
   user.wrong = 0.5;
   EXPECT(SYMSDE_FALSE_TRAIT, "own pendulum", symsde_model_probe(model, 0.0, &q0, &p0, &error));
   user.wrong = 0;
   user.refuse_after = -1;
   EXPECT(SYMSDE_CALLBACK_FAILED, "17", symsde_model_probe(model, 0.0, &q0, &p0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "q0 is NULL", symsde_model_probe(model, 0.0, NULL, &p0, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "p0 is NULL", symsde_model_probe(model, 0.0, &q0, NULL, &error));
   symsde_model_delete(&model);

   user.refuse_after = INFINITY;
   traits.additive = 1; /* sin q is not linear */
   OK(symsde_model_new("liar", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   EXPECT(SYMSDE_FALSE_TRAIT, "additive|liar", symsde_model_probe(model, 0.0, &q0, &p0, &error));
   symsde_model_delete(&model);

   traits.ndof = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "ndof >= 1",
          symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   traits.ndof = 2000000000;
   EXPECT(SYMSDE_TOO_LARGE, "degrees of freedom",
          symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   traits = pendulum_traits();
   EXPECT(SYMSDE_MISSING_OPERATION, "gradient",
          symsde_model_new("x", &traits, NULL, NULL, NULL, NULL, &user, &model, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "traits is NULL",
          symsde_model_new("x", NULL, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   traits.struct_size = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "symsde_traits_init first",
          symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   /* a caller compiled with an older header: members beyond the size of its struct keep their defaults */
   traits.struct_size = offsetof(symsde_traits, nnoise);
   OK(symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   symsde_traits_init(&got);
   OK(symsde_model_traits(model, &got, &error));
   CHECK(got.ndof == 1 && got.nnoise == 0 && got.separable == 0);
   memset(&got, 0x55, sizeof got);
   got.struct_size = offsetof(symsde_traits, nnoise);
   OK(symsde_model_traits(model, &got, &error));
   CHECK(got.ndof == 1 && got.nnoise == 0x55555555); /* nothing is written beyond the size of the caller's struct */
   symsde_model_delete(&model);
}

/* declared frequencies are copied, returned and checked; exact_rotation needs them */
static void test_rotation(void) {
   double omega[] = {1.5};
   pendulum_user user = {0.3, INFINITY, 0.0};
   symsde_traits traits = pendulum_traits(), got;
   symsde_model model = NULL;

   CHECK(traits.rotation == NULL);
   traits.rotation = omega;
   OK(symsde_model_new("turning", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   omega[0] = 7; /* the model keeps a copy */
   symsde_traits_init(&got);
   OK(symsde_model_traits(model, &got, &error));
   CHECK(got.rotation != NULL && got.rotation != omega && got.rotation[0] == 1.5);
   symsde_model_delete(&model);

   omega[0] = -1;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "rotation(1)|finite frequencies >= 0",
          symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   omega[0] = NAN;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "rotation(1)",
          symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   traits.ndof = 2000000000; /* refused before this many frequencies are read */
   EXPECT(SYMSDE_TOO_LARGE, "degrees of freedom",
          symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
}

/* a noise that is declared to be zero: the list is copied, returned, and refused if the noise is not zero */
static void test_silent(void) {
   const double at = 0.4;
   int32_t silent = 1;
   pendulum_user user = {0.0, INFINITY, 0.0};
   symsde_traits traits = pendulum_traits(), got;
   symsde_model model;
   traits.silent = &silent;
   OK(symsde_model_new("quiet", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &model, &error));
   OK(symsde_traits_init(&got) || symsde_model_traits(model, &got, &error));
   CHECK(got.silent != NULL && got.silent != &silent && got.silent[0] == 1);
   user.sigma = 0.3;
   EXPECT(SYMSDE_FALSE_TRAIT, "silent", symsde_model_probe(model, 0.0, &at, &at, &error));
   symsde_model_delete(&model);
}

static void test_evaluation(void) {
   enum { N = 1003 }; /* several blocks and a remainder */
   static double w[2 * N], q[N], p[N], value[N], hq[N], hp[N], hqq[N], hqp[N], hpp[N];
   pendulum_user user = {0.3, INFINITY, 0.0};
   symsde_model model = new_pendulum(&user), without = NULL;
   const symsde_traits traits = pendulum_traits();
   double worst = 0;

   for (int i = 0; i < N; i++) {
      q[i] = 0.01 * i;
      p[i] = 1 - 0.003 * i;
      w[i] = 0.5 + 0.001 * i;
      w[N + i] = -0.1 + 0.002 * i;
   }
   OK(symsde_model_value(model, N, 0.0, w, q, p, value, &error));
   OK(symsde_model_gradient(model, N, 0.0, w, q, p, hq, hp, &error));
   OK(symsde_model_hessian(model, N, 0.0, w, q, p, hqq, hqp, hpp, &error));
   for (int i = 0; i < N; i++) {
      worst = fmax(worst, fabs(value[i] - w[i] * (0.5 * p[i] * p[i] - cos(q[i])) - w[N + i] * 0.3 * sin(q[i])));
      worst = fmax(worst, fabs(hq[i] - w[i] * sin(q[i]) - w[N + i] * 0.3 * cos(q[i])) + fabs(hp[i] - w[i] * p[i]));
      worst = fmax(worst, fabs(hqq[i] - w[i] * cos(q[i]) + w[N + i] * 0.3 * sin(q[i])));
      worst = fmax(worst, fabs(hqp[i]) + fabs(hpp[i] - w[i]));
   }
   CHECK(worst < 1e-14);
   memset(hq, 0, sizeof hq);
   OK(symsde_model_gradient(model, N, 0.0, w, q, p, hq, NULL, &error));
   CHECK(fabs(hq[N - 1] - w[N - 1] * sin(q[N - 1]) - w[2 * N - 1] * 0.3 * cos(q[N - 1])) < 1e-14);
   OK(symsde_model_hessian(model, N, 0.0, w, q, p, NULL, NULL, hpp, &error));
   OK(symsde_model_value(model, 0, 0.0, w, q, p, value, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "hq", symsde_model_gradient(model, N, 0.0, w, q, p, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "hqq", symsde_model_hessian(model, N, 0.0, w, q, p, NULL, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "value is NULL", symsde_model_value(model, N, 0.0, w, q, p, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "w is NULL", symsde_model_value(model, N, 0.0, NULL, q, p, value, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "npath = -1", symsde_model_value(model, -1, 0.0, w, q, p, value, &error));
   EXPECT(SYMSDE_TOO_LARGE, "addressed", symsde_model_value(model, INT64_MAX, 0.0, w, q, p, value, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_model_get", symsde_model_value(NULL, N, 0.0, w, q, p, value, &error));
   user.refuse_after = 1;
   EXPECT(SYMSDE_CALLBACK_FAILED, "17", symsde_model_value(model, N, 2.0, w, q, p, value, &error));
   EXPECT(SYMSDE_CALLBACK_FAILED, "17", symsde_model_gradient(model, N, 2.0, w, q, p, hq, hp, &error));
   EXPECT(SYMSDE_CALLBACK_FAILED, "17", symsde_model_hessian(model, N, 2.0, w, q, p, hqq, NULL, NULL, &error));
   /* the message of a failure does not stay for the next call */
   OK(symsde_model_value(model, N, 0.0, w, q, p, value, &error));
   OK(symsde_model_new("x", &traits, pendulum_gradient, NULL, NULL, NULL, &user, &without, &error));
   EXPECT(SYMSDE_MISSING_OPERATION, "value", symsde_model_value(without, N, 0.0, w, q, p, value, &error));
   OK(symsde_model_hessian(without, N, 0.0, w, q, p, hqq, hqp, hpp, &error)); /* by differences */
   CHECK(fabs(hqq[7] - w[7] * cos(q[7]) + w[N + 7] * 0.3 * sin(q[7])) < 1e-7);
   symsde_model_delete(&model);
   symsde_model_delete(&without);
}

static void test_schemes(void) {
   const double nodes[] = {0.5}, one[] = {1.0}, bad_weights[] = {0.9}, node_outside[] = {1.5};
   /* Heun's tableau: rows 0, 0 and 1, 0; a transposed one would be implicit */
   const double heun[] = {0, 0, 1, 0}, half[] = {0.5, 0.5};
   char text[4096];
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_scheme_info info;
   size_t needed;

   symsde_scheme_info_init(&info);
   OK(symsde_scheme_get_info(scheme, &info, &error));
   CHECK(strcmp(info.name, "midpoint") == 0 && info.form == 1 && info.nstage == 1 && info.symplectic == 1);
   CHECK(info.symmetric == 1 && info.keeps_quadratic == 1 && info.correction_coefficient == 0);
   CHECK(info.order[1] == 1 && info.order_evidence[1] == SYMSDE_EVIDENCE_DERIVED);
   CHECK(fabs(info.measured_order[1] - 1) < 0.1 && info.measured_half_width[1] < 0.1);
   CHECK(info.keeps_bilinear == 1 && info.unknowns == 2 && strstr(info.reference, "WHSB") != NULL);
   OK(symsde_scheme_certificate(scheme, text, sizeof text, &needed, &error));
   CHECK(holds(text, "midpoint|symplectic|yes|weak") && needed == strlen(text) + 1);
   CHECK(symsde_scheme_delete(&scheme) == 0 && scheme == NULL && symsde_scheme_delete(&scheme) == 0);

   OK(symsde_scheme_from_quadrature(1, nodes, one, NULL, 1, "mine", &scheme, &error));
   OK(symsde_scheme_get_info(scheme, &info, &error));
   CHECK(strcmp(info.name, "mine") == 0 && info.symplectic == 1 && info.degree == 1);
   symsde_scheme_delete(&scheme);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "sum",
          symsde_scheme_from_quadrature(1, nodes, bad_weights, NULL, 1, "x", &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "outside",
          symsde_scheme_from_quadrature(1, node_outside, one, NULL, 1, "x", &scheme, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "degree 2", symsde_scheme_from_quadrature(1, nodes, one, NULL, 2, "x", &scheme, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "nnode = 0", symsde_scheme_from_quadrature(0, nodes, one, NULL, 1, "x", &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nodes is NULL",
          symsde_scheme_from_quadrature(1, NULL, one, NULL, 1, "x", &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "weights is NULL",
          symsde_scheme_from_quadrature(1, nodes, NULL, NULL, 1, "x", &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "name is NULL",
          symsde_scheme_from_quadrature(1, nodes, one, NULL, 1, NULL, &scheme, &error));

   OK(symsde_scheme_from_tableau(2, heun, heun, half, NULL, NULL, NULL, "my heun", 1, &scheme, &error));
   OK(symsde_scheme_get_info(scheme, &info, &error));
   CHECK(info.symplectic == 0 && info.nstage == 2);
   OK(symsde_scheme_certificate(scheme, text, sizeof text, NULL, &error));
   CHECK(strstr(text, "for every model") != NULL); /* explicit, so C's rows are the tableau's rows */
   symsde_scheme_delete(&scheme);
   EXPECT(SYMSDE_INCOMPATIBLE, "not symplectic|allow_nonsymplectic",
          symsde_scheme_from_tableau(2, heun, heun, half, NULL, NULL, NULL, "x", 0, &scheme, &error));
   CHECK(scheme == NULL);
   EXPECT(SYMSDE_WRONG_SHAPE, "nstage = -2",
          symsde_scheme_from_tableau(-2, heun, heun, half, NULL, NULL, NULL, "x", 1, &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "abar is NULL",
          symsde_scheme_from_tableau(2, heun, NULL, half, NULL, NULL, NULL, "x", 1, &scheme, &error));
   EXPECT(SYMSDE_UNKNOWN_NAME, "midpiont|midpoint", symsde_scheme_get("midpiont", &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "lambda", symsde_scheme_get("lambda:7", &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "name is NULL", symsde_scheme_get(NULL, &scheme, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "scheme is NULL", symsde_scheme_get("midpoint", NULL, &error));
}

/* The two-stage Gauss rule with weights 1/4 and 3/4 for the noise: a_ij from the Lagrange polynomials, by hand. */
static void check_tableau(symsde_scheme scheme, double root, const double *own) {
   const double a[2][2] = {{0.25, 0.25 - root}, {0.25 + root, 0.25}};
   double c[2], given[2][2], bar[2][2], alpha[2], b[2][2], bbar[2][2], beta[2];
   symsde_error error;

   OK(symsde_scheme_tableau(scheme, c, given[0], bar[0], alpha, b[0], bbar[0], beta, &error));
   for (int i = 0; i < 2; i++) {
      CHECK(fabs(c[i] - (0.5 + (i ? root : -root))) < 1e-15 && alpha[i] == 0.5 && beta[i] == own[i]);
      for (int j = 0; j < 2; j++) {
         CHECK(fabs(given[i][j] - a[i][j]) < 1e-15 && fabs(bar[i][j] - a[i][j]) < 1e-15);
         CHECK(fabs(b[i][j] - a[i][j] * own[j] / 0.5) < 1e-15);
         CHECK(fabs(bbar[i][j] - (own[j] - own[j] * a[j][i] / 0.5)) < 1e-15);
      }
   }
   OK(symsde_scheme_tableau(scheme, NULL, NULL, NULL, alpha, NULL, NULL, NULL, NULL));
}

static void test_schemes_from_schemes(void) {
   const double fractions[] = {0.25, 0.75}, half[] = {0.5, 0.5}, root = sqrt(3.0) / 6;
   const double nodes[] = {0.5 - root, 0.5 + root}, own[] = {0.25, 0.75}, bad[] = {0.5, 0.6}, a[] = {0.5}, b[] = {0.4};
   const double one[] = {1.0};
   symsde_scheme euler = new_scheme("symplectic_euler"), midpoint = new_scheme("midpoint"), made = NULL;
   symsde_scheme special = new_scheme("verlet_dz"), kicks = new_scheme("chin4a"), parts[] = {midpoint, midpoint},
                 holes[] = {midpoint, NULL};
   symsde_scheme_info info;

   symsde_scheme_info_init(&info);
   OK(symsde_scheme_adjoint(euler, NULL, &made, &error));
   OK(symsde_scheme_get_info(made, &info, &error));
   CHECK(strcmp(info.name, "symplectic_euler_adjoint") == 0 && info.correction_coefficient == -0.5);
   symsde_scheme_delete(&made);
   OK(symsde_scheme_symmetric_composition(euler, "verlet", &made, &error));
   OK(symsde_scheme_get_info(made, &info, &error));
   CHECK(strcmp(info.name, "verlet") == 0 && info.symmetric == 1 && info.nstage == 2 && info.symplectic == 1);
   symsde_scheme_delete(&made);
   OK(symsde_scheme_triple_jump(midpoint, NULL, &made, &error));
   OK(symsde_scheme_get_info(made, &info, &error));
   CHECK(strcmp(info.name, "midpoint_triple_jump") == 0 && info.nstage == 3 && info.keeps_quadratic == 1);
   symsde_scheme_delete(&made);
   OK(symsde_scheme_compose(2, parts, fractions, "two", &made, &error));
   OK(symsde_scheme_get_info(made, &info, &error));
   CHECK(strcmp(info.name, "two") == 0 && info.nstage == 2 && info.symmetric == 0 && info.keeps_quadratic == 1);
   symsde_scheme_delete(&made);
   EXPECT(SYMSDE_INCOMPATIBLE, "not symmetric", symsde_scheme_triple_jump(euler, NULL, &made, &error));
   CHECK(made == NULL);
   EXPECT(SYMSDE_INCOMPATIBLE, "verlet_dz", symsde_scheme_adjoint(special, NULL, &made, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_scheme_get", symsde_scheme_adjoint(NULL, NULL, &made, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_scheme_get", symsde_scheme_compose(2, holes, half, "x", &made, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "sum to", symsde_scheme_compose(2, parts, bad, "x", &made, &error));
   EXPECT(SYMSDE_WRONG_SHAPE, "npart = 0", symsde_scheme_compose(0, parts, half, "x", &made, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "parts is NULL", symsde_scheme_compose(2, NULL, half, "x", &made, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "scheme is NULL", symsde_scheme_triple_jump(midpoint, NULL, NULL, &error));

   OK(symsde_scheme_from_quadrature(2, nodes, half, own, 2, "own", &made, &error));
   check_tableau(made, root, own);
   EXPECT(SYMSDE_MISSING_OPERATION, "chin4a is no tableau",
          symsde_scheme_tableau(kicks, NULL, NULL, NULL, NULL, NULL, NULL, NULL, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_scheme_get",
          symsde_scheme_tableau(NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, &error));
   symsde_scheme_delete(&kicks);
   OK(symsde_scheme_get_info(made, &info, &error));
   CHECK(info.symplectic == 1 && info.correction_coefficient == 0 && strcmp(info.name, "own") == 0);
   symsde_scheme_delete(&made);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "noise weights",
          symsde_scheme_from_quadrature(2, nodes, half, bad, 2, "x", &made, &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "not symplectic",
          symsde_scheme_from_tableau(1, a, a, one, b, NULL, NULL, "x", 0, &made, &error));
   OK(symsde_scheme_from_tableau(1, a, a, one, a, a, one, "x", 0, &made, &error));
   symsde_scheme_delete(&made);
   symsde_scheme_delete(&special);
   symsde_scheme_delete(&midpoint);
   symsde_scheme_delete(&euler);
}

static void test_commutator(void) {
   const double q[1][3] = {{0.3, -0.7, 1.1}}, p[1][3] = {{0.5, 0.2, -0.4}};
   double gradients[2];
   int32_t commute[2];
   char text[256];
   symsde_model kubo = NULL, mixed = NULL;

   OK(symsde_model_get("kubo", 0, NULL, NULL, &kubo, &error));
   OK(symsde_model_get("noncommutative_oscillator", 0, NULL, NULL, &mixed, &error));
   OK(symsde_commutator(kubo, 0.0, 3, q[0], p[0], gradients, commute, text, sizeof text, NULL, NULL, &error));
   CHECK(commute[0] == 1 && commute[1] == 1 && gradients[1] < 1e-6);
   OK(symsde_commutator(mixed, 0.0, 3, q[0], p[0], gradients, commute, text, sizeof text, NULL, NULL, &error));
   CHECK(commute[0] == 0 && gradients[0] > 0.1 && text[0] != 0);
   OK(symsde_commutator(mixed, 0.0, 3, q[0], p[0], gradients, commute, NULL, 0, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "npoint = 0",
          symsde_commutator(mixed, 0.0, 0, q[0], p[0], gradients, commute, text, sizeof text, NULL, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "gradients is NULL",
          symsde_commutator(mixed, 0.0, 3, q[0], p[0], NULL, commute, text, sizeof text, NULL, NULL, &error));
   symsde_model_delete(&kubo);
   symsde_model_delete(&mixed);
}

enum { POINTS = 21, PATHS = 2 };

static void test_stationary_path(void) {
   const double start[PATHS] = {0.3, -0.2}, end[PATHS] = {0.5, 0.4}, far[PATHS] = {0.5, NAN};
   double q[POINTS][1][PATHS], p[POINTS][1][PATHS], again[POINTS][1][PATHS], residual[4][PATHS];
   double dw[POINTS - 1][2][PATHS], none[POINTS - 1][1][PATHS] = {{{0}}}, largest = 0, gap = 0;
   int32_t status[PATHS];
   symsde_model model = NULL, oscillator = NULL;
   symsde_scheme scheme = new_scheme("gauss2"), midpoint = new_scheme("midpoint"), heun = new_scheme("heun");
   symsde_options options;

   OK(symsde_model_get("synchrotron", 0, NULL, NULL, &model, &error));
   OK(symsde_model_get("linear_oscillator", 0, NULL, NULL, &oscillator, &error));
   symsde_options_init(&options);
   options.step = 0.05;
   options.steps = POINTS - 1;
   options.paths = PATHS;
   options.seed = 3;
   OK(symsde_stationary_path(model, scheme, &options, start, end, NULL, NULL, NULL, &q[0][0][0], &p[0][0][0], status,
                             &error));
   CHECK(status[0] == 0 && status[1] == 0 && q[0][0][1] == start[1] && q[POINTS - 1][0][0] == end[0]);
   OK(symsde_increments(model, NULL, &options, &dw[0][0][0], &error));
   OK(symsde_euler_lagrange_residual(model, scheme, &options, &q[0][0][0], &p[0][0][0], &dw[0][0][0], &residual[0][0],
                                     &error));
   for (int i = 0; i < 4; i++) {
      largest = fmax(largest, fmax(residual[i][0], residual[i][1]));
   }
   CHECK(largest < 1e-13);
   OK(symsde_stationary_path(model, scheme, &options, start, end, &dw[0][0][0], &q[0][0][0], &p[0][0][0],
                             &again[0][0][0], &p[0][0][0], status, &error));
   for (int i = 0; i < POINTS; i++) {
      gap = fmax(gap, fabs(again[i][0][0] - q[i][0][0]));
   }
   CHECK(gap < 1e-13);
   options.step = 2 * tan(acos(-1.0) / (2 * (POINTS - 1))); /* half a turn of the oscillator */
   EXPECT(SYMSDE_PATHS_FAILED, "2 of 2 paths|conjugate",
          symsde_stationary_path(oscillator, midpoint, &options, start, end, &none[0][0][0], NULL, NULL, &q[0][0][0],
                                 &p[0][0][0], status, &error));
   CHECK(status[0] == SYMSDE_SINGULAR && isnan(q[3][0][1]));
   EXPECT(SYMSDE_INCOMPATIBLE, "heun",
          symsde_stationary_path(model, heun, &options, start, end, NULL, NULL, NULL, &q[0][0][0], &p[0][0][0], status,
                                 &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "q_end holds",
          symsde_stationary_path(model, scheme, &options, start, far, NULL, NULL, NULL, &q[0][0][0], &p[0][0][0],
                                 status, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "q_start is NULL",
          symsde_stationary_path(model, scheme, &options, NULL, end, NULL, NULL, NULL, &q[0][0][0], &p[0][0][0], status,
                                 &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "path_status is NULL",
          symsde_stationary_path(model, scheme, &options, start, end, NULL, NULL, NULL, &q[0][0][0], &p[0][0][0], NULL,
                                 &error));
   symsde_scheme_delete(&heun);
   symsde_scheme_delete(&midpoint);
   symsde_scheme_delete(&scheme);
   symsde_model_delete(&oscillator);
   symsde_model_delete(&model);
}

static void test_handles(void) {
   char text[64];
   static int64_t foreign[64];
   symsde_model model = NULL;
   symsde_scheme scheme = new_scheme("midpoint");
   symsde_scheme_info info;
   symsde_traits traits;

   symsde_scheme_info_init(&info);
   symsde_traits_init(&traits);
   OK(symsde_model_get("kubo", 0, NULL, NULL, &model, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_model_new", symsde_model_traits(NULL, &traits, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "not a model", symsde_model_traits((symsde_model)scheme, &traits, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "not a model", symsde_model_traits((symsde_model)foreign, &traits, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "symsde_scheme_get", symsde_scheme_get_info(NULL, &info, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "not a scheme", symsde_scheme_get_info((symsde_scheme)model, &info, &error));
   EXPECT(SYMSDE_NULL_HANDLE, "scheme", symsde_scheme_certificate(NULL, text, sizeof text, NULL, &error));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "scheme_info is NULL", symsde_scheme_get_info(scheme, NULL, &error));
   info.struct_size = sizeof info + 8;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "symsde_scheme_info_init", symsde_scheme_get_info(scheme, &info, &error));
   CHECK(symsde_model_delete((symsde_model *)&scheme) == SYMSDE_NULL_HANDLE && scheme != NULL);
   CHECK(symsde_scheme_delete((symsde_scheme *)&model) == SYMSDE_NULL_HANDLE && model != NULL);
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
}

int main(void) {
   test_texts();
   test_inits();
   test_builtin_models();
   test_own_model();
   test_rotation();
   test_silent();
   test_evaluation();
   test_schemes();
   test_schemes_from_schemes();
   test_commutator();
   test_stationary_path();
   test_handles();
   return close_report();
}
