
static void STEP_strip(const int lanes, const int nstep, const int max_iter, const ptrdiff_t stride, LANE_IN, double *x,
                       int64_t *restrict status) {
   (void)max_iter, (void)status;
   double other[MAY_BE_FAR ? STEP_ROWS * STRIP : 1], *from = x, *to = MAY_BE_FAR ? other : x;
   for (int left = nstep; left > 0;) {
      const int some = n == 1 || n == STEP_FEW ? left : left >= STEP_GROUP ? STEP_GROUP : 1;
      STEP_several(lanes, some, stride, LANE_OF, from, to);
      left -= some;
      w += some * stride;
      double *const swap = from;
      from = to;
      to = swap;
   }
   for (int k = 0; k < STEP_ROWS && from != x; k++)
      memcpy(x + k * STRIP, from + k * STRIP, (size_t)lanes * sizeof *x);
}
