
/* ---- STEP without iterations: a group of steps keeps the state of a lane in registers ---- */

#if STEP_KEPT
INLINE STEP_places(const int lanes, LANE_IN, double *restrict x, const int far) {
   int64_t beyond = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      state s = state_of(x, i, 0);
      beyond |= places(w + i, n, OF_LANE(i), h FADE, &s, s.e, far);
      put_state(s, x, i, STEP_KEPT);
   }
   return beyond;
}

/* Compute the kept parts before the first step. */
static void STEP_begin(const int lanes, LANE_IN, double *restrict x) {
   if (STEP_places(lanes, LANE_OF, x, 0) < 0)
      STEP_places(lanes, LANE_OF, x, 1);
}
#endif

/* Steps of lanes from x to y, which may be x. */
INLINE STEP_in_lanes(const int lanes, const int steps, const ptrdiff_t stride, LANE_IN, const double *x, double *y,
                     const int far) {
   int64_t beyond = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      state s = state_of(x, i, STEP_KEPT);
#pragma GCC unroll 8
      for (int j = 0; j < steps; j++)
         beyond |= STEP(w + j * stride + i, n, OF_LANE(i), h FADE, &s, far);
      put_state(s, y, i, STEP_KEPT);
   }
   return beyond;
}

/* Steps of a single vector of lanes, one after the other; 0: such a block is taken as others are. */
enum { STEP_FEW = MAY_BE_FAR ? 8 : 0 };

#if MAY_BE_FAR
static int64_t STEP_few(const int steps, const ptrdiff_t stride, LANE_IN, const double *x, double *restrict y) {
   double z[STEP_ROWS * STRIP];
   int64_t beyond = 0;
   for (int k = 0; k < STEP_ROWS; k++)
      memcpy(z + k * STRIP, x + k * STRIP, STEP_FEW * sizeof *z);
#pragma GCC unroll 1
   for (int j = 0; j < steps; j++)
      beyond |= STEP_in_lanes(STEP_FEW, 1, stride, w + j * stride, n, c, h FADE, z, z, 0);
   for (int k = 0; k < STEP_ROWS; k++)
      memcpy(y + k * STRIP, z + k * STRIP, STEP_FEW * sizeof *z);
   return beyond;
}
#endif

SELDOM STEP_far(const int lanes, const int steps, const ptrdiff_t stride, LANE_IN, const double *x, double *y) {
   for (int j = 0; j < steps; j++, x = y)
      STEP_in_lanes(lanes, 1, stride, w + j * stride, n, c, h FADE, x, y, 1);
}

/* The steps of a single path. */
#if STEP_LINEAR
enum { STEP_CHUNK = 64 };

LANE void STEP_turns(const int steps, double m[COEFFICIENTS][STEP_CHUNK], state *x) {
   state s = *x;
#pragma GCC unroll 1
   for (int j = 0; j < steps; j++) {
      double e[COEFFICIENTS];
      for (int k = 0; k < WANTED; k++)
         e[k] = m[k][j];
      STEP_turn(e, &s);
   }
   *x = s;
}

INLINE STEP_alone(const int steps, const ptrdiff_t stride, LANE_IN, const double *x, double *y) {
   double m[COEFFICIENTS][STEP_CHUNK];
   state s = state_of(x, 0, STEP_KEPT);
   for (int first = 0; first < steps; first += STEP_CHUNK) {
      const int some = steps - first < STEP_CHUNK ? steps - first : STEP_CHUNK;
#pragma GCC ivdep
      for (int j = 0; j < some; j++) { /* stored together */
         double own[COEFFICIENTS];
         STEP_coefficients(w + (first + j) * stride, n, c, h FADE, own, 0);
         for (int k = 0; k < WANTED; k++)
            m[k][j] = own[k];
      }
      STEP_turns(some, m, &s);
   }
   put_state(s, y, 0, STEP_KEPT);
   return 0;
}
#else
INLINE STEP_alone(const int steps, const ptrdiff_t stride, LANE_IN, const double *x, double *y) {
   int64_t beyond = 0;
   state s = state_of(x, 0, STEP_KEPT);
#pragma GCC unroll 1
   for (int j = 0; j < steps; j++)
      beyond |= STEP(w + j * stride, n, c, h FADE, &s, ALONE);
   put_state(s, y, 0, STEP_KEPT);
   return beyond;
}
#endif

/* Steps from x to y: STEP_GROUP or one, or any number of a single path or vector. If lanes may be far, x and y are
 * different arrays, so that steps can be repeated. */
static void STEP_several(const int lanes, const int steps, const ptrdiff_t stride, LANE_IN, const double *x, double *y) {
   const int64_t beyond = n == 1                ? STEP_alone(steps, STEP_WIDTH * NHAM, w, 1, c, h FADE, x, y)
#if MAY_BE_FAR
                          : n == STEP_FEW       ? STEP_few(steps, stride, LANE_OF, x, y)
#endif
                          : steps == STEP_GROUP ? STEP_in_lanes(lanes, STEP_GROUP, stride, LANE_OF, x, y, 0)
                                                : STEP_in_lanes(lanes, 1, stride, LANE_OF, x, y, 0);
   if (MAY_BE_FAR && beyond < 0)
      STEP_far(lanes, steps, stride, LANE_OF, x, y);
}
