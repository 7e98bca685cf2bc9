
/* Where velocities are linear in p, S_p(p) = v + S_pp p, the momenta are eliminated: Newton's correction of G = -S_q(Q),
 * Q = q + v/2 + S_pp G/4, by I + S_qq S_pp/4, and how steep that is: its largest diagonal entry less one. */
INLINE midpoint_correction(LANE_IN, const state *s, const double *z, double *d, const int far) {
   state m = *s;
   double matrix[DOF][DOF], hq[DOF], hqq[DOF * DOF], hpp[DOF * DOF], v[DOF];
   int64_t beyond = velocity(LANE_OF, s, v, far) | mobility(LANE_OF, s, hpp, far);
   for (int k = 0; k < DOF; k++) {
      m.q[k] += 0.5 * v[k];
      for (int l = 0; l < DOF; l++)
         m.q[k] += 0.25 * hpp[k * DOF + l] * z[l];
   }
   beyond |= stiffness(LANE_OF, &m, hq, hqq, far);
   d[DOF] = 0;
   for (int i = 0; i < DOF; i++) {
      d[i] = z[i] + hq[i];
      for (int k = 0; k < DOF; k++) {
         matrix[i][k] = i == k;
         for (int l = 0; l < DOF; l++)
            matrix[i][k] += 0.25 * hqq[i * DOF + l] * hpp[l * DOF + k];
      }
      d[DOF] = matrix[i][i] - 1 > d[DOF] ? matrix[i][i] - 1 : d[DOF];
   }
   eliminate(matrix, d);
   return beyond;
}

INLINE midpoint_guess(LANE_IN, const state *s, double *z, const int far) {
   (void)w, (void)n, (void)c, (void)s, (void)far;
   for (int k = 0; k < DOF; k++)
      z[k] = 0;
   return 0;
}

LANE void midpoint_increment(LANE_IN, const state *s, const double *z, double *dq, double *dp) {
   double hpp[DOF * DOF];
   velocity(LANE_OF, s, dq, 0);
   mobility(LANE_OF, s, hpp, 0);
   for (int i = 0; i < DOF; i++) {
      dp[i] = z[i];
      for (int k = 0; k < DOF; k++)
         dq[i] += 0.5 * hpp[i * DOF + k] * z[k];
   }
}

/* In a steep lane v + S_pp G/2 loses digits: one correction more of F = dq itself, F = v - S_pp S_q(q + F/2)/2. */
LANE void midpoint_steep_increment(LANE_IN, const state *s, const double *z, double *dq, double *dp) {
   state m = *s;
   double matrix[DOF][DOF], hq[DOF], hqq[DOF * DOF], hpp[DOF * DOF], v[DOF], r[DOF];
   midpoint_increment(LANE_OF, s, z, dq, dp);
   velocity(LANE_OF, s, v, 1);
   mobility(LANE_OF, s, hpp, 1);
   for (int k = 0; k < DOF; k++)
      m.q[k] += 0.5 * dq[k];
   stiffness(LANE_OF, &m, hq, hqq, 1);
   for (int i = 0; i < DOF; i++) {
      r[i] = dq[i] - v[i];
      for (int k = 0; k < DOF; k++) {
         r[i] += 0.5 * hpp[i * DOF + k] * hq[k];
         matrix[i][k] = i == k;
         for (int l = 0; l < DOF; l++)
            matrix[i][k] += 0.25 * hpp[i * DOF + l] * hqq[l * DOF + k];
      }
   }
   eliminate(matrix, r);
   for (int k = 0; k < DOF; k++)
      dq[k] -= r[k];
}
