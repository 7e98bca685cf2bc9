
/* Newton's correction of (F, G) = (S_p, -S_q) at (q + F/2, p + G/2): in closed form for one degree of freedom, the F
 * eliminated for several, whose S_qp vanish. */
INLINE midpoint_correction(LANE_IN, const state *s, const double *z, double *d, const int far) {
   state m;
   double hq[DOF], hp[DOF], hqq[DOF * DOF], hqp[DOF * DOF], hpp[DOF * DOF];
   for (int k = 0; k < DOF; k++) {
      m.q[k] = s->q[k] + 0.5 * z[k];
      m.p[k] = s->p[k] + 0.5 * z[DOF + k];
   }
   const int64_t beyond = slopes(LANE_OF, &m, hq, hp, hqq, hqp, hpp, far);
#if DOF == 1
   const double a = 0.5 * hqq[0], b = 0.5 * hqp[0], e = 0.5 * hpp[0];
   const double f = z[0] - hp[0], g = z[1] + hq[0];
   const double inverse = 1 / (1 - b * b + a * e);
   d[0] = ((1 + b) * f + e * g) * inverse;
   d[1] = ((1 - b) * g - a * f) * inverse;
#else
   double matrix[DOF][DOF], r[DOF];
   for (int i = 0; i < DOF; i++) {
      r[i] = z[DOF + i] + hq[i];
      for (int k = 0; k < DOF; k++) {
         r[i] -= 0.5 * hqq[i * DOF + k] * (z[k] - hp[k]);
         matrix[i][k] = i == k;
         for (int l = 0; l < DOF; l++)
            matrix[i][k] += 0.25 * hqq[i * DOF + l] * hpp[l * DOF + k];
      }
   }
   eliminate(matrix, r);
   for (int i = 0; i < DOF; i++) {
      d[i] = z[i] - hp[i];
      d[DOF + i] = r[i];
      for (int k = 0; k < DOF; k++)
         d[i] += 0.5 * hpp[i * DOF + k] * r[k];
   }
#endif
   d[2 * DOF] = 0;
   return beyond;
}

/* F at the beginning of the step, as if there were no force */
INLINE midpoint_guess(LANE_IN, const state *s, double *z, const int far) {
   const int64_t beyond = velocity(LANE_OF, s, z, far);
   for (int k = 0; k < DOF; k++)
      z[DOF + k] = 0;
   return beyond;
}

LANE void midpoint_increment(LANE_IN, const state *s, const double *z, double *dq, double *dp) {
   for (int k = 0; k < DOF; k++) {
      dq[k] = z[k];
      dp[k] = z[DOF + k];
   }
}

/* of quadratic Hamiltonians: one correction is the solution */
INLINE midpoint(LANE_IN, state *s, const int far) {
   double z[2 * DOF], d[2 * DOF + 1];
   for (int k = 0; k < 2 * DOF; k++)
      z[k] = 0;
   const int64_t beyond = midpoint_correction(LANE_OF, s, z, d, far);
   for (int k = 0; k < DOF; k++) {
      s->q[k] -= d[k];
      s->p[k] -= d[DOF + k];
   }
   return beyond;
}

#define midpoint_steep_increment midpoint_increment /* both unknowns are there */
