/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Streaming observers through the C interface: kept beside moments, merged, read, refused.
 */
#include "run.h"

enum { BINS = 10, SLOTS = BINS + 3, WIDEST = 4096, LISTED = 1000, PARTS = 3 };

static const int32_t q_value = 0, both_values[] = {0, 1}, all_values[] = {0, 1, 2};
static const double median = 0.5;
static const int64_t chosen[] = {3, 299};

static symsde_observer observer_of(int kind, int nvalue, const int32_t *values, double low, double high, int bins) {
   symsde_observer o;
   symsde_observer_init(&o);
   CHECK(o.bridges == 1 && o.absorbs == 0 && o.counts == NULL && o.sums == NULL);
   o.kind = kind;
   o.nvalue = nvalue;
   o.values = values;
   o.low = low;
   o.high = high;
   o.bins = bins;
   return o;
}

enum { HISTOGRAM, QUANTILE, COVARIANCE, AUTOCORRELATION, EXTREMES, PASSAGE, CHOSEN, KINDS };

static symsde_observer kind_number(int i) {
   symsde_observer o = {0};
   switch (i) {
   case HISTOGRAM:
      return observer_of(SYMSDE_OBSERVE_HISTOGRAM, 1, &q_value, -1, 1, BINS);
   case QUANTILE:
      o = observer_of(SYMSDE_OBSERVE_QUANTILES, 1, &q_value, 1e-3, 10, 16);
      o.nshare = 1;
      o.shares = &median;
      return o;
   case COVARIANCE:
      return observer_of(SYMSDE_OBSERVE_COVARIANCE, 2, both_values, 0, 0, 0);
   case AUTOCORRELATION:
      return observer_of(SYMSDE_OBSERVE_AUTOCORRELATION, 1, &q_value, 0, 0, 3);
   case EXTREMES:
      return observer_of(SYMSDE_OBSERVE_EXTREMES, 1, &q_value, 0, 0, 0);
   case PASSAGE:
      o = observer_of(SYMSDE_OBSERVE_PASSAGE, 1, &q_value, -0.9, 2, 0);
      o.absorbs = 0;
      return o;
   default:
      o = observer_of(SYMSDE_OBSERVE_PATHS, 3, all_values, 0, 0, 0);
      o.npath = 2;
      o.paths = chosen;
      return o;
   }
}

static symsde_model model;
static symsde_scheme scheme;

/* moments with observers of paths first .. first + paths - 1 */
static int run_with(int64_t first, int64_t paths, symsde_observer *const *observers, int n) {
   static double t[NTIME], mean[3 * NTIME], variance[3 * NTIME], se[3 * NTIME];
   static int64_t n_ok[NTIME];
   static symsde_moments m;
   symsde_options options = some_options();
   const symsde_input input = some_input(&one, &zero);

   options.first_path = first;
   options.paths = paths;
   symsde_moments_init(&m);
   CHECK(m.nobserver == 0 && m.observers == NULL);
   m.t = t;
   m.n_ok = n_ok;
   m.mean = mean;
   m.variance = variance;
   m.se_mean = se;
   m.nobserver = n;
   m.observers = observers;
   return symsde_compute_moments(model, scheme, &options, &input, &m, NULL, &error);
}

static void allocate(symsde_observer *o, int64_t *sizes) {
   const symsde_options options = some_options();
   OK(symsde_observer_sizes(model, &options, 0, o, sizes, &error));
   /* no memory is needed for zero sums */
   o->counts = sizes[0] > 0 ? calloc((size_t)sizes[0], sizeof *o->counts) : NULL;
   o->sums = sizes[1] > 0 ? calloc((size_t)sizes[1], sizeof *o->sums) : NULL;
}

/* all kinds in one run of 300 paths, and in parts of 256 and 44 that merge to the same bits */
static void test_all_kinds(void) {
   symsde_observer whole[KINDS], left[KINDS], right[KINDS], *lists[PARTS][KINDS];
   int64_t sizes[KINDS][3];
   const symsde_options options = some_options();
   double *values = malloc(WIDEST * sizeof *values), *errors = malloc(WIDEST * sizeof *errors);

   for (int i = 0; i < KINDS; i++) {
      whole[i] = left[i] = right[i] = kind_number(i);
      allocate(lists[0][i] = &whole[i], sizes[i]);
      allocate(lists[1][i] = &left[i], sizes[i]);
      allocate(lists[2][i] = &right[i], sizes[i]);
      CHECK(sizes[i][2] <= WIDEST);
   }
   CHECK(sizes[HISTOGRAM][0] == NTIME * SLOTS && sizes[HISTOGRAM][1] == 0 && sizes[HISTOGRAM][2] == NTIME * SLOTS);
   CHECK(sizes[QUANTILE][2] == NTIME && sizes[COVARIANCE][1] == NTIME * (1 + 2 + 4 * 3));
   CHECK(sizes[COVARIANCE][2] == NTIME * 3 && sizes[AUTOCORRELATION][1] == 4 * (1 + 4 + 10));
   CHECK(sizes[EXTREMES][0] == 4 && sizes[EXTREMES][1] == 2 + NTIME * 5);
   CHECK(sizes[PASSAGE][0] == 3 * NTIME + 1 + 2 * LISTED && sizes[PASSAGE][1] == 3 * LISTED + 1 + 3 + 3);
   CHECK(sizes[CHOSEN][0] == 2 && sizes[CHOSEN][1] == 2 * 3 * NTIME);
   OK(run_with(0, PATHS, lists[0], KINDS));
   OK(run_with(0, 256, lists[1], KINDS));
   OK(run_with(256, PATHS - 256, lists[2], KINDS));
   for (int i = 0; i < KINDS; i++) {
      OK(symsde_observer_merge(model, &options, 0, &left[i], &right[i], &error));
      CHECK(sizes[i][0] == 0 || memcmp(left[i].counts, whole[i].counts, (size_t)sizes[i][0] * sizeof(int64_t)) == 0);
      CHECK(sizes[i][1] == 0 || memcmp(left[i].sums, whole[i].sums, (size_t)sizes[i][1] * sizeof(double)) == 0);
      OK(symsde_observer_answer(model, &options, 0, &whole[i], values, errors, &error));
      if (i == HISTOGRAM) {
         int64_t total = 0;
         for (int k = 0; k < SLOTS; k++) {
            total += whole[i].counts[(NTIME - 1) * SLOTS + k];
         }
         CHECK(total == PATHS && whole[i].counts[SLOTS - 2] == PATHS); /* q = 1 initially, above the last bin */
         CHECK(values[SLOTS - 2] == 1 && errors[SLOTS - 2] == 0);
      } else if (i == QUANTILE) {
         CHECK(fabs(values[0] - 1) <= errors[0] && errors[0] < 0.1);
      } else if (i == COVARIANCE) {
         CHECK(values[0] == 0 && values[3] > 0 && fabs(values[4] * values[4]) <= values[3] * values[5]);
         CHECK(errors[3] > 0 && errors[3] < values[3]);
      } else if (i == AUTOCORRELATION) {
         CHECK(values[1] == 1 && errors[1] == 0 && errors[3] > 0);
      } else if (i == EXTREMES) {
         CHECK(whole[i].sums[0] < -0.9 && whole[i].sums[1] >= 1 && values[2 * NTIME - 2] < -0.5);
      } else if (i == PASSAGE) {
         const double lost = values[2 * NTIME - 2];
         CHECK(lost > 0.1 && fabs(errors[2 * NTIME - 2] - sqrt(lost * (1 - lost) / PATHS)) < 1e-12);
         CHECK(whole[i].counts[3 * NTIME] > 0 && values[2 * NTIME - 1] == 0);
      } else {
         CHECK(values[0] == 1 && values[1] == 0 && values[2] == 0.5 && whole[i].counts[1] == 0);
      }
   }
   free(right[0].counts); /* a run may leave out integers and sums, a merge may not */
   right[0].counts = NULL;
   OK(run_with(256, PATHS - 256, lists[2], KINDS));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "counts is NULL",
          symsde_observer_merge(model, &options, 0, &left[0], &right[0], &error));
   EXPECT(SYMSDE_INCOMPATIBLE, "different kinds",
          symsde_observer_merge(model, &options, 0, &left[COVARIANCE], &right[EXTREMES], &error));
   for (int i = 0; i < KINDS; i++) {
      free(whole[i].counts);
      free(whole[i].sums);
      free(left[i].counts);
      free(left[i].sums);
      free(right[i].counts);
      free(right[i].sums);
   }
   free(values);
   free(errors);
}

/* means of two groups of paths, 256 and the others but the last: those of runs of these paths alone */
static void test_groups(void) {
   static int32_t labels[PATHS];
   symsde_observer o = observer_of(SYMSDE_OBSERVE_MEANS, 3, all_values, 0, 0, 0), *list[] = {&o}, alone;
   int64_t sizes[3], one[3];

   alone = o;
   allocate(&alone, one);
   o.ngroup = 2;
   allocate(&o, sizes);
   CHECK(one[1] == NTIME * 7 && sizes[1] == 2 * one[1] && sizes[2] == 2 * one[2]);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "labels of an observer is NULL", run_with(0, PATHS, list, 1));
   for (int i = 0; i < PATHS; i++) {
      labels[i] = i < 256;
   }
   labels[PATHS - 1] = -1;
   o.labels = labels;
   OK(run_with(0, PATHS, list, 1));
   list[0] = &alone;
   OK(run_with(0, 256, list, 1));
   CHECK(memcmp(o.sums + one[1], alone.sums, (size_t)one[1] * sizeof(double)) == 0);
   OK(run_with(256, PATHS - 257, list, 1));
   CHECK(memcmp(o.sums, alone.sums, (size_t)one[1] * sizeof(double)) == 0);
   o.ngroup = -1;
   list[0] = &o;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "ngroup = -1", run_with(0, PATHS, list, 1));
   free(o.sums);
   free(alone.sums);
}

static void test_refusals(void) {
   const symsde_options options = some_options();
   const int32_t wrong = 3;
   int64_t sizes[3];
   double x[NTIME * 3];
   symsde_observer o = kind_number(HISTOGRAM), *list[] = {&o};

   o.kind = 9;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "kind 9|give 1 to 8", run_with(0, PATHS, list, 1));
   o.kind = SYMSDE_OBSERVE_HISTOGRAM;
   o.values = &wrong;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "values 4 to 4|there are 3", run_with(0, PATHS, list, 1));
   o.values = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "values of an observer is NULL", run_with(0, PATHS, list, 1));
   o.nvalue = -1;
   EXPECT(SYMSDE_WRONG_SHAPE, "negative", symsde_observer_sizes(model, &options, 0, &o, sizes, &error));
   o.struct_size = 4;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "struct_size of observer", run_with(0, PATHS, list, 1));
   list[0] = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "observer is NULL", run_with(0, PATHS, list, 1));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "observers is NULL", run_with(0, PATHS, NULL, 1));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "nobserver = -1", run_with(0, PATHS, list, -1));
   o = kind_number(HISTOGRAM);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "sizes is NULL", symsde_observer_sizes(model, &options, 0, &o, NULL, &error));
   o = kind_number(CHOSEN);
   o.paths = NULL;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "paths of an observer is NULL",
          symsde_observer_sizes(model, &options, 0, &o, sizes, &error));
   o = kind_number(COVARIANCE);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "sums is NULL", symsde_observer_answer(model, &options, 0, &o, x, x, &error));
}

int main(void) {
   model = new_kubo();
   OK(symsde_scheme_get("midpoint", &scheme, &error));
   test_all_kinds();
   test_groups();
   test_refusals();
   symsde_model_delete(&model);
   symsde_scheme_delete(&scheme);
   return close_report();
}
