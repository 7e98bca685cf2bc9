
/* ---- STEP, which needs no iterations: a group of steps keeps the state of a lane in registers ---- */

INLINE STEP_in_lanes(const int lanes, const int steps, const ptrdiff_t stride, LANE_IN, double *restrict x,
                     const int far) {
   int64_t beyond = 0;
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      state s = state_of(x, i);
#pragma GCC unroll 8
      for (int j = 0; j < steps; j++)
         beyond |= STEP(w + j * stride + i, n, c, h, &s, far);
      put_state(s, x, i);
   }
   return beyond;
}

SELDOM STEP_far(const int lanes, const int steps, const ptrdiff_t stride, LANE_IN, double *restrict x) {
   for (int j = 0; j < steps; j++)
      STEP_in_lanes(lanes, 1, stride, w + j * stride, n, c, h, x, 1);
}

/* The steps of a path that is alone. */
INLINE STEP_alone(const int steps, const ptrdiff_t stride, LANE_IN, double *restrict x) {
   int64_t beyond = 0;
   state s = state_of(x, 0);
#pragma GCC unroll 1
   for (int j = 0; j < steps; j++)
      beyond |= STEP(w + j * stride, n, c, h, &s, 0);
   put_state(s, x, 0);
   return beyond;
}

static void STEP_several(const int lanes, const int steps, const ptrdiff_t stride, LANE_IN, double *restrict x) {
   double before[2 * DOF * STRIP];
   if (MAY_BE_FAR)
      memcpy(before, x, sizeof before);
   const int64_t beyond = lanes == 1       ? STEP_alone(steps, stride, LANE_OF, x)
                          : steps == GROUP ? STEP_in_lanes(lanes, GROUP, stride, LANE_OF, x, 0)
                                           : STEP_in_lanes(lanes, 1, stride, LANE_OF, x, 0);
   if (MAY_BE_FAR && beyond < 0) {
      memcpy(x, before, sizeof before);
      STEP_far(lanes, steps, stride, LANE_OF, x);
   }
}

static void STEP_strip(const int lanes, const int nstep, const int max_iter, const ptrdiff_t stride, LANE_IN,
                       double *restrict x, int64_t *restrict status) {
   (void)max_iter, (void)status;
   int left = nstep;
   for (; left >= GROUP && lanes > 1; left -= GROUP, w += GROUP * stride)
      STEP_several(lanes, GROUP, stride, LANE_OF, x);
   if (lanes == 1 && left > 0)
      STEP_several(1, left, stride, LANE_OF, x);
   else
      for (; left > 0; left--, w += stride)
         STEP_several(lanes, 1, stride, LANE_OF, x);
}
