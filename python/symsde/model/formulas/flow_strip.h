
/* Steps of a strip in place. If a lane fails, the function ends, and the library repeats the steps one by one. */
static void STEP_strip(const int lanes, const int nstep, const int max_iter, const ptrdiff_t stride, LANE_IN,
                       double *restrict x, int64_t *restrict status) {
   double other[2 * DOF * STRIP], *from = x, *to = other;
   if (lanes == 1) {
      state s = state_of(x, 0, STEP_KEPT);
      int64_t outcome = 0;
#pragma GCC unroll 1
      for (int step = 0; step < nstep && outcome == 0; step++)
         outcome = STEP_PASSalone(max_iter, w + step * stride, n, c, h FADE, &s, status);
      put_state(s, x, 0, STEP_KEPT);
      return;
   }
   for (int step = 0; step < nstep; step++, w += stride) {
      /* one vector of lanes keeps its unknowns in registers */
      const int64_t outcome = lanes == 8 ? STEP_PASSone(8, max_iter, LANE_OF, from, to, status)
                                         : STEP_PASSone(lanes, max_iter, LANE_OF, from, to, status);
      double *const swap = from;
      from = to;
      to = swap;
      if (outcome < 0)
         break;
   }
   for (int k = 0; k < STEP_ROWS && from != x; k++)
      memcpy(x + k * STRIP, from + k * STRIP, (size_t)lanes * sizeof *x);
}
