
/* Steps of a strip in place, by weights of a few steps at a time. */
static void STEP_strip(const int lanes, const int nstep, const double *restrict z, const double *restrict kk,
                       const double *restrict law, LANE_IN, double *restrict x) {
   enum { FEW = 64, ROWS = STEP_WIDTH * NHAM, MOST = STRIP * STEP_GROUP > FEW ? STRIP * STEP_GROUP : FEW };
   double u[ROWS * MOST], other[STEP_ROWS * STRIP];
   const ptrdiff_t m = lanes; /* rows of weights beside each other stay in cache */
   double *from = x, *to = MAY_BE_FAR ? other : x;
   for (int step = 0; step < nstep;) {
      const int left = nstep - step, most = lanes == 1 ? FEW : n == STEP_FEW ? MOST / 8 : STEP_GROUP;
      const int some = lanes == 1 || n == STEP_FEW ? (left < most ? left : most) : left >= most ? most : 1;
      for (int j = 0; j < some; j++, step++)
         STEP_WEIGH(lanes, h, w + step * NHAM * n, z + step * (NHAM - 1) * n, kk + step * (NHAM - 1) * n, n, law,
                    u + j * ROWS * m, m);
      STEP_several(lanes, some, ROWS * m, u, m, c, h FADE, from, to);
      double *const swap = from;
      from = to;
      to = swap;
   }
   for (int k = 0; k < STEP_ROWS && from != x; k++)
      memcpy(x + k * STRIP, from + k * STRIP, (size_t)lanes * sizeof *x);
}

/* The contract of symsde_flow in symsde.h. */
int formula_flow_STEP(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h,
                      const double *w, const double *const *functionals, const double *q, const double *p, double *qn,
                      double *pn, int64_t *status, void *user) {
   (void)ndof, (void)nham, (void)max_iter, (void)t, (void)status;
   FADE_OF(functionals);
   const double *const law = DAMPED ? functionals[GAMMA_H] + 1 : STEP_law, *const c = PARAMETERS(user);
   const double *const kk = functionals[2] ? functionals[2] : functionals[0];
   const ptrdiff_t n = nlane;
   for (ptrdiff_t first = 0; first < n; first += STRIP) {
      const int lanes = n - first < STRIP ? (int)(n - first) : STRIP;
      double x[STEP_ROWS * STRIP];
      for (int k = 0; k < DOF; k++) {
         memcpy(x + k * STRIP, q + k * n + first, (size_t)lanes * sizeof(double));
         memcpy(x + (DOF + k) * STRIP, p + k * n + first, (size_t)lanes * sizeof(double));
      }
#if STEP_KEPT
      STEP_begin(lanes, w + first, n, c, h FADE, x);
#endif
      for (int out = 0; out < nstep / every; out++) {
         const ptrdiff_t before = (ptrdiff_t)out * every * n;
         STEP_strip(lanes, every, functionals[0] + before * (NHAM - 1) + first, kk + before * (NHAM - 1) + first, law,
                    w + before * NHAM + first, n, c, h FADE, x);
         for (int k = 0; k < DOF; k++) {
            memcpy(qn + (out * DOF + k) * n + first, x + k * STRIP, (size_t)lanes * sizeof(double));
            memcpy(pn + (out * DOF + k) * n + first, x + (DOF + k) * STRIP, (size_t)lanes * sizeof(double));
         }
      }
   }
   return 0;
}
