
/* ---- STEP by sweeps, as in src/step/stages/fixed_point.f90; lanes in which sweeps fail are left to Newton ---- */

enum { STEP_AT_ONCE = 3, STEP_MOST = 24 }; /* sweeps of all lanes, and the most sweeps of a lane */

/* A further sweep, and the verdict on it. */
INLINE STEP_again(LANE_IN, const state *s, double *g, double *f, double *change, double *size) {
   const int64_t beyond = STEP_sweep(LANE_OF, s, g, f, 0);
   double largest = 0, sum = 0;
   *size = 0;
   for (int k = 0; k < STEP_SLOPES; k++) {
      const double d = f[k] - g[k];
      largest = fabs(d) > largest ? fabs(d) : largest;
      *size = fabs(f[k]) > *size ? fabs(f[k]) : *size;
      sum += d;
   }
   *change = largest + 0 * sum; /* NaN if anything is not finite */
   return beyond;
}

/* The sweeps that every lane does: slopes, and the verdict. */
LANE double STEP_at_once(LANE_IN, const state *s, double *g) {
   double f[STEP_SLOPES], last, change, size;
   int64_t beyond = STEP_sweep(LANE_OF, s, g, g, 1);
   beyond |= STEP_again(LANE_OF, s, g, f, &last, &size);
   beyond |= STEP_again(LANE_OF, s, f, g, &change, &size);
   return either(beyond >> 63, -2, sweep_verdict(change, size, last));
}

LANE double STEP_once_more(LANE_IN, const state *s, double *g, const double last) {
   const int64_t rests = bits_of(last) >> 63;
   double f[STEP_SLOPES], change, size;
   const int64_t beyond = STEP_again(LANE_OF, s, g, f, &change, &size);
   for (int k = 0; k < STEP_SLOPES; k++)
      g[k] = either(rests, g[k], f[k]);
   return either(rests, last, either(beyond >> 63, -2, sweep_verdict(change, size, last)));
}

/* Sweeps of all lanes, and the state y as if they were the last; negative if a lane needs more sweeps. */
LANE int64_t STEP_sweeps(const int lanes, LANE_IN, const double *restrict x, double *restrict u, double *restrict y,
                         const int first) {
   int64_t going = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double g[STEP_SLOPES], last;
      state s = state_of(x, i, 0);
      if (first) {
         last = STEP_at_once(w + i, n, OF_LANE(i), h FADE, &s, g);
      } else {
         for (int k = 0; k < STEP_SLOPES; k++)
            g[k] = u[k * STRIP + i];
         last = STEP_once_more(w + i, n, OF_LANE(i), h FADE, &s, g, u[STEP_SLOPES * STRIP + i]);
      }
      for (int k = 0; k < STEP_SLOPES; k++)
         u[k * STRIP + i] = g[k];
      u[STEP_SLOPES * STRIP + i] = last;
      going |= ~bits_of(last);
      STEP_arrive(w + i, n, OF_LANE(i), h FADE, &s, g);
      put_state(s, y, i, 0);
   }
   return going;
}

SELDOM STEP_alone_by_newton(const int max_iter, LANE_IN, state *s, int64_t *restrict status, int64_t *outcome) {
   *outcome |= STEP_alone(max_iter, LANE_OF, s, status);
}

/* Newton for lanes that sweeps did not solve; one by one if matrices are large, since vector code would compile slowly. */
#if DOF > 2
SELDOM STEP_by_newton(const int lanes, const int max_iter, LANE_IN, const double *restrict x,
                      const double *restrict last, double *restrict y, int64_t *restrict status, int64_t *outcome) {
   for (int i = 0; i < lanes; i++) {
      if (last[i] == -1)
         continue;
      state s = state_of(x, i, 0);
      STEP_alone_by_newton(max_iter, w + i, n, OF_LANE(i), h FADE, &s, status + i, outcome);
      put_state(s, y, i, 0);
   }
}
#else
static __attribute__((noinline)) void STEP_by_newton(const int lanes, const int max_iter, LANE_IN,
                                                     const double *restrict x, const double *restrict last,
                                                     double *restrict y, int64_t *restrict status, int64_t *outcome) {
   double other[2 * DOF * STRIP];
   int64_t own[STRIP];
   for (int i = 0; i < lanes; i++)
      own[i] = last[i] == -1 ? 1 : status[i]; /* solved lanes do no work */
   *outcome = STEP_one(lanes, max_iter, LANE_OF, x, other, own);
   for (int i = 0; i < lanes; i++) {
      if (last[i] == -1)
         continue;
      status[i] = own[i];
      for (int k = 0; k < 2 * DOF; k++)
         y[k * STRIP + i] = other[k * STRIP + i];
   }
}
#endif

/* A step of some lanes, from x to y. */
INLINE STEP_swept_one(const int lanes, const int max_iter, LANE_IN, const double *restrict x, double *restrict y,
                      int64_t *restrict status) {
   double u[(STEP_SLOPES + 1) * STRIP];
   int64_t outcome = 0, left = 0;
   int64_t going = STEP_sweeps(lanes, LANE_OF, x, u, y, 1);
   for (int sweep = STEP_AT_ONCE; sweep < STEP_MOST && going < 0; sweep++)
      going = STEP_sweeps(lanes, LANE_OF, x, u, y, 0);
   for (int i = 0; i < lanes; i++)
      left |= bits_of(u[STEP_SLOPES * STRIP + i]) ^ bits_of(-1.0);
   if (left != 0)
      STEP_by_newton(lanes, max_iter, LANE_OF, x, u + STEP_SLOPES * STRIP, y, status, &outcome);
   return outcome;
}

/* A step of a single path: the next operations do not wait for verdicts. */
INLINE STEP_swept_alone(const int max_iter, LANE_IN, state *s, int64_t *restrict status) {
   double g[STEP_SLOPES], f[STEP_SLOPES], last = STEP_at_once(LANE_OF, s, g), change, size;
   int64_t outcome = 0;
   for (int sweep = STEP_AT_ONCE; sweep < STEP_MOST && last >= 0; sweep++) {
      const int64_t beyond = STEP_again(LANE_OF, s, g, f, &change, &size);
      for (int k = 0; k < STEP_SLOPES; k++)
         g[k] = f[k];
      last = beyond < 0 ? -2 : sweep_verdict(change, size, last);
   }
   if (last == -1)
      STEP_arrive(LANE_OF, s, g);
   else
      STEP_alone_by_newton(max_iter, LANE_OF, s, status, &outcome);
   return outcome;
}
