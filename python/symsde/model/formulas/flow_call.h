
/* The contract of symsde_flow in symsde.h. */
int formula_flow_STEP(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h,
                      const double *w, const double *const *functionals, const double *q, const double *p, double *qn,
                      double *pn, int64_t *status, void *user) {
   (void)ndof, (void)t, (void)functionals;
   FADE_OF(functionals);
   const ptrdiff_t n = nlane, stride = nham * n;
   const double *const c = PARAMETERS(user);
   for (ptrdiff_t first = 0; first < n; first += STRIP) {
      const int lanes = n - first < STRIP ? (int)(n - first) : STRIP;
      double x[STEP_ROWS * STRIP];
      for (int k = 0; k < DOF; k++) {
         memcpy(x + k * STRIP, q + k * n + first, (size_t)lanes * sizeof(double));
         memcpy(x + (DOF + k) * STRIP, p + k * n + first, (size_t)lanes * sizeof(double));
      }
#if STEP_KEPT
      STEP_begin(lanes, w + first, n, OF_LANE(first), h FADE, x);
#endif
      for (int out = 0; out < nstep / every; out++) {
         STEP_strip(lanes, every, max_iter, stride, w + out * every * stride + first, n, OF_LANE(first), h FADE, x,
                    status + first);
         for (int k = 0; k < DOF; k++) {
            memcpy(qn + (out * DOF + k) * n + first, x + k * STRIP, (size_t)lanes * sizeof(double));
            memcpy(pn + (out * DOF + k) * n + first, x + (DOF + k) * STRIP, (size_t)lanes * sizeof(double));
         }
      }
   }
   return 0;
}
