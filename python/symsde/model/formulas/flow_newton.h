
/* ---- STEP by Newton's iteration, each lane until its own corrections stagnate ---- */

/* The state of a lane between iterations: its unknowns, the size of its last correction, or done (-1), or failed (-2),
 * and the steepness of the equations. */
typedef struct {
   double z[STEP_UNKNOWNS], last, steep;
} STEP_lane;

LANE STEP_lane STEP_lane_of(const double *restrict u, const int i) {
   STEP_lane lane;
   for (int k = 0; k < STEP_UNKNOWNS; k++)
      lane.z[k] = u[k * STRIP + i];
   lane.last = u[STEP_UNKNOWNS * STRIP + i];
   lane.steep = u[(STEP_UNKNOWNS + 1) * STRIP + i];
   return lane;
}

LANE void STEP_put(const STEP_lane lane, const int i, double *restrict u) {
   for (int k = 0; k < STEP_UNKNOWNS; k++)
      u[k * STRIP + i] = lane.z[k];
   u[STEP_UNKNOWNS * STRIP + i] = lane.last;
   u[(STEP_UNKNOWNS + 1) * STRIP + i] = lane.steep;
}

/* Set a lane up before the first iteration; a lane with a nonzero status does no work. */
INLINE STEP_begin(LANE_IN, const state *s, const int64_t status, STEP_lane *lane, const int far) {
   lane->last = status == 0 ? 0 : -1;
   lane->steep = 0;
   return STEP_guess(LANE_OF, s, lane->z, far);
}

/* One correction from the derivatives e, and the verdict on it; `first`: the first correction. A lane that is done keeps
 * its values. */
LANE void STEP_correct(LANE_IN, const state *s, const double *e, STEP_lane *lane, const int first) {
   /* by bits: conditions would become branches, which prevent vectors */
   const int64_t rests = bits_of(lane->last) >> 63;
   double d[STEP_UNKNOWNS + 1], largest = 0, size = 0, sum = 0;
   STEP_correction(LANE_OF, s, lane->z, e, d);
   for (int k = 0; k < STEP_UNKNOWNS; k++) {
      const double next = either(rests, lane->z[k], lane->z[k] - d[k]);
      largest = fabs(d[k]) > largest ? fabs(d[k]) : largest;
      size = fabs(next) > size ? fabs(next) : size;
      sum += d[k] + next;
      lane->z[k] = next;
   }
   const double correction = largest + 0 * sum; /* NaN if anything is not finite */
   const double next = first ? first_verdict(correction, size) : verdict(correction, size, lane->last);
   lane->steep = either(rests, lane->steep, d[STEP_UNKNOWNS]); /* does not depend on neighbours */
   lane->last = either(rests, lane->last, next);
}

/* Two short loops over lanes, which a processor overlaps: one for the derivatives, one for the corrections. */
INLINE STEP_derivatives(const int lanes, LANE_IN, const double *restrict x, const int64_t *restrict status,
                        double *restrict u, double *restrict v, const int first, const int far) {
   int64_t beyond = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double e[STEP_DERIVATIVES];
      state s = state_of(x, i, STEP_KEPT);
      STEP_lose(&s);
      STEP_lane lane;
      if (first) {
         beyond |= STEP_begin(w + i, n, OF_LANE(i), h FADE, &s, status[i], &lane, far);
         STEP_put(lane, i, u);
      } else {
         lane = STEP_lane_of(u, i);
      }
      beyond |= STEP_evaluate(w + i, n, OF_LANE(i), h FADE, &s, lane.z, e, far);
#pragma GCC unroll 80
      for (int k = 0; k < STEP_DERIVATIVES; k++)
         v[k * STRIP + i] = e[k];
   }
   return beyond;
}

SELDOM STEP_far(const int lanes, LANE_IN, const double *restrict x, const int64_t *restrict status, double *restrict u,
                double *restrict v, const int first) {
   if (first)
      STEP_derivatives(lanes, LANE_OF, x, status, u, v, 1, 1);
   else
      STEP_derivatives(lanes, LANE_OF, x, status, u, v, 0, 1);
}

/* Work that remains in some lane. */
typedef struct {
   int64_t going, undone, gentle; /* negative: iterations; not 0: any work; negative: a steep lane */
} STEP_rest;

/* Correct all lanes; after the first correction also compute the state y, as if a correction were the last. */
LANE STEP_rest STEP_corrections(const int lanes, LANE_IN, const double *restrict x, const double *restrict v,
                                double *restrict u, double *restrict y, const int first) {
   int64_t going = 0, undone = 0, gentle = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double e[STEP_DERIVATIVES];
      state s = state_of(x, i, STEP_KEPT);
      STEP_lose(&s);
      STEP_lane lane = STEP_lane_of(u, i);
#pragma GCC unroll 80
      for (int k = 0; k < STEP_DERIVATIVES; k++)
         e[k] = v[k * STRIP + i];
      STEP_correct(w + i, n, OF_LANE(i), h FADE, &s, e, &lane, first);
      going |= ~bits_of(lane.last);
      undone |= bits_of(lane.last) ^ bits_of(-1.0);
      gentle |= bits_of(1 - lane.steep);
      STEP_put(lane, i, u);
      if (!first) {
         STEP_increment(w + i, n, OF_LANE(i), h FADE, &s, lane.z);
         STEP_lose(&s);
         put_state(s, y, i, STEP_KEPT);
      }
   }
   return (STEP_rest){going, undone, gentle};
}

/* Steep lanes compute their state by another formula; lanes without a solution get a status, and a negative outcome. */
SELDOM STEP_sort_out(const int lanes, LANE_IN, const double *restrict x, const double *restrict u,
                     int64_t *restrict status, double *restrict y, int64_t *outcome) {
   for (int i = 0; i < lanes; i++) {
      const STEP_lane lane = STEP_lane_of(u, i);
      if (lane.steep > 1) {
         state s = state_of(x, i, STEP_KEPT);
         STEP_lose(&s);
         STEP_steep_increment(w + i, n, OF_LANE(i), h FADE, &s, lane.z);
         STEP_lose(&s);
         put_state(s, y, i, STEP_KEPT);
      }
      if (lane.last > -1.5 && lane.last < 0)
         continue;
      status[i] = lane.last >= 0 ? NOT_CONVERGED : NONFINITE;
      *outcome = -1;
   }
}

/* A step of some lanes, from x to y. */
INLINE STEP_one(const int lanes, const int max_iter, LANE_IN, const double *restrict x, double *restrict y,
                int64_t *restrict status) {
   double u[(STEP_UNKNOWNS + 2) * STRIP], v[STEP_DERIVATIVES * STRIP];
   int64_t outcome = 0;
   if (STEP_derivatives(lanes, LANE_OF, x, status, u, v, 1, 0) < 0)
      STEP_far(lanes, LANE_OF, x, status, u, v, 1);
   STEP_rest rest = STEP_corrections(lanes, LANE_OF, x, v, u, y, 1);
   for (int iteration = 1; iteration < max_iter && (iteration == 1 || rest.going < 0); iteration++) {
      if (STEP_derivatives(lanes, LANE_OF, x, status, u, v, 0, 0) < 0)
         STEP_far(lanes, LANE_OF, x, status, u, v, 0);
      rest = STEP_corrections(lanes, LANE_OF, x, v, u, y, 0);
   }
   if (rest.undone != 0 || rest.gentle < 0)
      STEP_sort_out(lanes, LANE_OF, x, u, status, y, &outcome);
   return outcome;
}

/* Derivatives for a single path. */
INLINE STEP_look(LANE_IN, const state *s, const double *z, double *e) {
   if (STEP_evaluate(LANE_OF, s, z, e, ALONE) < 0)
      STEP_evaluate(LANE_OF, s, z, e, 1);
   return 0;
}

/* A step of a single path, whose data stay in registers. */
INLINE STEP_alone(const int max_iter, LANE_IN, state *s, int64_t *restrict status) {
   double e[STEP_DERIVATIVES];
   STEP_lane lane;
   STEP_lose(s);
   if (STEP_begin(LANE_OF, s, *status, &lane, ALONE) < 0)
      STEP_begin(LANE_OF, s, *status, &lane, 1);
   STEP_look(LANE_OF, s, lane.z, e);
   STEP_correct(LANE_OF, s, e, &lane, 1);
   for (int iteration = 1; iteration < max_iter && lane.last >= 0; iteration++) {
      STEP_look(LANE_OF, s, lane.z, e);
      STEP_correct(LANE_OF, s, e, &lane, 0);
   }
   if (lane.steep > 1)
      STEP_steep_increment(LANE_OF, s, lane.z);
   else
      STEP_increment(LANE_OF, s, lane.z);
   STEP_lose(s);
   if (lane.last > -1.5 && lane.last < 0)
      return 0;
   *status = lane.last >= 0 ? NOT_CONVERGED : NONFINITE;
   return -1;
}
