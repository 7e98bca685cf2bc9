
/* Derivatives at (q + F/2, p + G/2): S_q, S_p and the blocks of the Hessian, one after the other. */
enum { AT_P = DOF, AT_QQ = 2 * DOF, AT_QP = AT_QQ + DOF * DOF, AT_PP = AT_QP + DOF * DOF };
#define midpoint_DERIVATIVES (2 * DOF + 3 * DOF * DOF)

INLINE midpoint_evaluate(LANE_IN, const state *s, const double *z, double *e, const int far) {
   state m = *s;
   for (int k = 0; k < DOF; k++) {
      m.q[k] = FMA(0.5, z[k], m.q[k]);
      m.p[k] = FMA(0.5, z[DOF + k], m.p[k]);
   }
   return slopes(LANE_OF, &m, e, e + AT_P, e + AT_QQ, e + AT_QP, e + AT_PP, far);
}

/* (f, g) times the inverse of Newton's matrix of (F, G) = (S_p, -S_q) is d times the returned number: in closed form
 * for one degree of freedom; for several whose S_qp vanish with F eliminated. */
LANE double midpoint_solve(const double *e, const double *f, const double *g, double *d) {
   const double *hqq = e + AT_QQ, *hqp = e + AT_QP, *hpp = e + AT_PP;
#if DOF == 1
   const double a = 0.5 * hqq[0], b = 0.5 * hqp[0], k = 0.5 * hpp[0];
   d[0] = FMA(k, g[0], (1 + b) * f[0]);
   d[1] = FMA(-a, f[0], (1 - b) * g[0]);
   return 1 / FMA(a, k, FMA(-b, b, 1.0));
#elif MIXED
   double matrix[4 * DOF * DOF];
   for (int i = 0; i < DOF; i++) {
      double *const above = matrix + 2 * DOF * i, *const below = above + 2 * DOF * DOF;
      d[i] = f[i];
      d[DOF + i] = g[i];
      for (int k = 0; k < DOF; k++) {
         above[k] = FMA(-0.5, hqp[i * DOF + k], i == k);
         above[DOF + k] = -0.5 * hpp[i * DOF + k];
         below[k] = 0.5 * hqq[i * DOF + k];
         below[DOF + k] = FMA(0.5, hqp[k * DOF + i], i == k);
      }
   }
   eliminate_both(matrix, d);
   return 1;
#else
   double matrix[DOF * DOF];
   for (int i = 0; i < DOF; i++) {
      d[DOF + i] = g[i];
      for (int k = 0; k < DOF; k++) {
         d[DOF + i] = FMA(-0.5 * hqq[i * DOF + k], f[k], d[DOF + i]);
         double *const entry = matrix + i * DOF + k;
         *entry = i == k;
         for (int l = 0; l < DOF; l++)
            *entry = FMA(0.25 * hqq[i * DOF + l], hpp[l * DOF + k], *entry);
      }
   }
   eliminate(matrix, d + DOF);
   for (int i = 0; i < DOF; i++) {
      d[i] = f[i];
      for (int k = 0; k < DOF; k++)
         d[i] = FMA(0.5 * hpp[i * DOF + k], d[DOF + k], d[i]);
   }
   return 1;
#endif
}

LANE void midpoint_correction(LANE_IN, const state *s, const double *z, const double *e, double *d) {
   (void)w, (void)n, (void)c, (void)h, (void)s;
   double f[DOF], g[DOF];
   for (int k = 0; k < DOF; k++) {
      f[k] = z[k] - e[AT_P + k];
      g[k] = z[DOF + k] + e[k];
   }
   const double inverse = midpoint_solve(e, f, g, d);
   for (int k = 0; k < 2 * DOF; k++)
      d[k] *= inverse;
   d[2 * DOF] = 0;
}

/* F at the beginning of the step, as if there were no force */
INLINE midpoint_guess(LANE_IN, const state *s, double *z, const int far) {
   const int64_t beyond = velocity(LANE_OF, s, z, far);
   for (int k = 0; k < DOF; k++)
      z[DOF + k] = 0;
   return beyond;
}

LANE void midpoint_increment(LANE_IN, state *s, const double *z) {
   (void)w, (void)n, (void)c, (void)h;
   for (int k = 0; k < DOF; k++) {
      s->q[k] += z[k];
      s->p[k] += z[DOF + k];
   }
}

#if DOF == 1
#else
/* for quadratic Hamiltonians one correction is the solution */
INLINE midpoint(LANE_IN, state *s, const int far) {
   double e[midpoint_DERIVATIVES], d[2 * DOF], g[DOF];
   lose(fade.half, s);
   const int64_t beyond = slopes(LANE_OF, s, e, e + AT_P, e + AT_QQ, e + AT_QP, e + AT_PP, far);
   for (int k = 0; k < DOF; k++)
      g[k] = -e[k];
   const double inverse = midpoint_solve(e, e + AT_P, g, d);
   for (int k = 0; k < DOF; k++) {
      s->q[k] = FMA(d[k], inverse, s->q[k]);
      s->p[k] = FMA(d[DOF + k], inverse, s->p[k]);
   }
   lose(fade.half, s);
   return beyond;
}
#endif

#define midpoint_steep_increment midpoint_increment /* both unknowns are known */
