
/* ---- STEP by Newton's iteration, each lane until its own corrections stagnate ---- */

/* A correction of the unknowns z of lane i into v, the verdict on it, and how steep the equations are where it was
 * made. */
LANE void STEP_correct(const double *z, const double *d, const double last, const double steep, const int i,
                          double *restrict v) {
   double largest = 0, size = 0, sum = 0;
   for (int k = 0; k < STEP_UNKNOWNS; k++) {
      const double next = last >= 0 ? z[k] - d[k] : z[k];
      largest = fabs(d[k]) > largest ? fabs(d[k]) : largest;
      size = fabs(next) > size ? fabs(next) : size;
      sum += d[k];
      v[k * STRIP + i] = next;
   }
   const double next = verdict(largest + 0 * sum, size, last); /* 0 * sum keeps a NaN */
   v[STEP_UNKNOWNS * STRIP + i] = next;
   v[(STEP_UNKNOWNS + 1) * STRIP + i] = last >= 0 ? d[STEP_UNKNOWNS] : steep; /* of the lane, not of its neighbours */
}

/* How many lanes go on: counted in a loop of its own, because compilers count under a condition what a loop knows to be
 * negative, and make no vectors of that. */
LANE int64_t STEP_going(const int lanes, const double *restrict v) {
   int64_t going = lanes;
   for (int i = 0; i < lanes; i++)
      going += bits_of(v[STEP_UNKNOWNS * STRIP + i]) >> 63;
   return going;
}

/* The first iteration, from a guess, in lanes without a status; how many lanes go on. */
INLINE STEP_first(const int lanes, LANE_IN, const double *restrict x, const int64_t *restrict status,
                  double *restrict v, int64_t *running, const int far) {
   int64_t beyond = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double z[STEP_UNKNOWNS], d[STEP_UNKNOWNS + 1];
      const state s = state_of(x, i);
      beyond |= STEP_guess(w + i, n, c, h, &s, z, far);
      beyond |= STEP_correction(w + i, n, c, h, &s, z, d, far);
      STEP_correct(z, d, status[i] == 0 ? 0 : -2, 0, i, v);
   }
   *running = STEP_going(lanes, v);
   return beyond;
}

/* One iteration more, from the unknowns u. */
INLINE STEP_next(const int lanes, LANE_IN, const double *restrict x, const double *restrict u, double *restrict v,
                 int64_t *running, const int far) {
   int64_t beyond = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double z[STEP_UNKNOWNS], d[STEP_UNKNOWNS + 1];
      const state s = state_of(x, i);
      for (int k = 0; k < STEP_UNKNOWNS; k++)
         z[k] = u[k * STRIP + i];
      beyond |= STEP_correction(w + i, n, c, h, &s, z, d, far);
      STEP_correct(z, d, u[STEP_UNKNOWNS * STRIP + i], u[(STEP_UNKNOWNS + 1) * STRIP + i], i, v);
   }
   *running = STEP_going(lanes, v);
   return beyond;
}

SELDOM STEP_far(const int lanes, LANE_IN, const double *restrict x, const int64_t *restrict status,
                const double *restrict u, double *restrict v, int64_t *running) {
   if (u == NULL)
      STEP_first(lanes, LANE_OF, x, status, v, running, 1);
   else
      STEP_next(lanes, LANE_OF, x, u, v, running, 1);
}

/* Lanes that found no solution get a status; negative where there are some. */
SELDOM STEP_fail(const int lanes, const double *restrict u, int64_t *restrict status) {
   for (int i = 0; i < lanes; i++) {
      const double last = u[STEP_UNKNOWNS * STRIP + i];
      if (status[i] == 0 && (last >= 0 || last < -1.5))
         status[i] = last >= 0 ? NOT_CONVERGED : NONFINITE;
   }
}

LANE void STEP_add(const double *restrict dq, const double *restrict dp, const int i, double *restrict x) {
   for (int k = 0; k < DOF; k++) {
      x[k * STRIP + i] += dq[k];
      x[(DOF + k) * STRIP + i] += dp[k];
   }
}

/* From the unknowns to the new state. */
LANE void STEP_finish(const int lanes, LANE_IN, const double *restrict u, double *restrict x) {
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double z[STEP_UNKNOWNS], dq[DOF], dp[DOF];
      const state s = state_of(x, i);
      for (int k = 0; k < STEP_UNKNOWNS; k++)
         z[k] = u[k * STRIP + i];
      STEP_increment(w + i, n, c, h, &s, z, dq, dp);
      STEP_add(dq, dp, i, x);
   }
}

/* The same where some lanes are steep. */
SELDOM STEP_finish_steep(const int lanes, LANE_IN, const double *restrict u, double *restrict x) {
   for (int i = 0; i < lanes; i++) {
      double z[STEP_UNKNOWNS], dq[DOF], dp[DOF];
      const state s = state_of(x, i);
      for (int k = 0; k < STEP_UNKNOWNS; k++)
         z[k] = u[k * STRIP + i];
      if (u[(STEP_UNKNOWNS + 1) * STRIP + i] > 1)
         STEP_steep_increment(w + i, n, c, h, &s, z, dq, dp);
      else
         STEP_increment(w + i, n, c, h, &s, z, dq, dp);
      STEP_add(dq, dp, i, x);
   }
}

INLINE STEP_one(const int lanes, const int max_iter, LANE_IN, double *restrict x, int64_t *restrict status) {
   double a[(STEP_UNKNOWNS + 2) * STRIP], b[(STEP_UNKNOWNS + 2) * STRIP], *u = a, *v = b;
   int64_t running, bad = 0, gentle = 0;
   if (STEP_first(lanes, LANE_OF, x, status, u, &running, 0) < 0)
      STEP_far(lanes, LANE_OF, x, status, NULL, u, &running);
   for (int iteration = 1; iteration < max_iter && running > 0; iteration++) {
      if (STEP_next(lanes, LANE_OF, x, u, v, &running, 0) < 0)
         STEP_far(lanes, LANE_OF, x, status, u, v, &running);
      double *const swap = u;
      u = v;
      v = swap;
   }
   for (int i = 0; i < lanes; i++) {
      bad |= bits_of(u[STEP_UNKNOWNS * STRIP + i] + 1.5); /* done is -1, failed -2 */
      gentle |= bits_of(1 - u[(STEP_UNKNOWNS + 1) * STRIP + i]);
   }
   if (gentle < 0)
      STEP_finish_steep(lanes, LANE_OF, u, x);
   else
      STEP_finish(lanes, LANE_OF, u, x);
   if (running > 0 || bad < 0) {
      STEP_fail(lanes, u, status);
      return -1;
   }
   return 0;
}

/* A lane that fails ends the steps: the library takes them again, one by one. */
static void STEP_strip(const int lanes, const int nstep, const int max_iter, const ptrdiff_t stride, LANE_IN,
                       double *restrict x, int64_t *restrict status) {
   for (int step = 0; step < nstep; step++, w += stride) {
      const int64_t outcome = lanes == 1 ? STEP_one(1, max_iter, LANE_OF, x, status)
                                         : STEP_one(lanes, max_iter, LANE_OF, x, status);
      if (outcome < 0)
         return;
   }
}
