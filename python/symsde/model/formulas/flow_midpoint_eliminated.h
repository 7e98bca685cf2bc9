
/* Where velocities are linear in p, S_p(p) = v + S_pp p, the momenta are eliminated: Newton's correction of G = -S_q(Q),
 * Q = q + v/2 + S_pp G/4, by I + S_qq S_pp/4, and the steepness, the largest diagonal entry of this matrix minus
 * one. */
#define midpoint_DERIVATIVES (DOF + DOF * DOF)

INLINE midpoint_evaluate(LANE_IN, const state *s, const double *z, double *e, const int far) {
   state m = *s;
   double hpp[DOF * DOF], v[DOF];
   int64_t beyond = velocity(LANE_OF, s, v, far) | mobility(LANE_OF, s, hpp, far);
   for (int k = 0; k < DOF; k++) {
      m.q[k] = FMA(0.5, v[k], m.q[k]);
      for (int l = 0; l < DOF; l++)
         m.q[k] = FMA(0.25 * hpp[k * DOF + l], z[l], m.q[k]);
   }
   return beyond | stiffness(LANE_OF, &m, e, e + DOF, far);
}

LANE void midpoint_correction(LANE_IN, const state *s, const double *z, const double *e, double *d) {
   const double *hqq = e + DOF;
   double matrix[DOF * DOF], hpp[DOF * DOF];
   mobility(LANE_OF, s, hpp, 0);
   d[DOF] = 0;
   for (int i = 0; i < DOF; i++) {
      d[i] = z[i] + e[i];
      for (int k = 0; k < DOF; k++) {
         double entry = 0;
         for (int l = 0; l < DOF; l++)
            entry = FMA(0.25 * hpp[l * DOF + k], hqq[i * DOF + l], entry);
         matrix[i * DOF + k] = entry + (i == k);
         if (i == k)
            d[DOF] = entry > d[DOF] ? entry : d[DOF];
      }
   }
   eliminate(matrix, d);
}

INLINE midpoint_guess(LANE_IN, const state *s, double *z, const int far) {
   (void)w, (void)n, (void)c, (void)h, (void)s, (void)far;
   for (int k = 0; k < DOF; k++)
      z[k] = 0;
   return 0;
}

/* dq = v + S_pp G/2 */
LANE void midpoint_displacement(LANE_IN, const state *s, const double *z, double *dq, const int far) {
   double hpp[DOF * DOF];
   velocity(LANE_OF, s, dq, far);
   mobility(LANE_OF, s, hpp, far);
   for (int i = 0; i < DOF; i++)
      for (int k = 0; k < DOF; k++)
         dq[i] = FMA(0.5 * hpp[i * DOF + k], z[k], dq[i]);
}

LANE void midpoint_increment(LANE_IN, state *s, const double *z) {
   double dq[DOF];
   midpoint_displacement(LANE_OF, s, z, dq, 0);
   for (int k = 0; k < DOF; k++) {
      s->q[k] += dq[k];
      s->p[k] += z[k];
   }
}

/* In a steep lane v + S_pp G/2 loses digits: one more correction, of F = dq itself, F = v - S_pp S_q(q + F/2)/2. */
LANE void midpoint_steep_increment(LANE_IN, state *s, const double *z) {
   state m = *s;
   double matrix[DOF * DOF], hq[DOF], hqq[DOF * DOF], hpp[DOF * DOF], v[DOF], r[DOF], dq[DOF];
   midpoint_displacement(LANE_OF, s, z, dq, 1);
   velocity(LANE_OF, s, v, 1);
   mobility(LANE_OF, s, hpp, 1);
   for (int k = 0; k < DOF; k++)
      m.q[k] += 0.5 * dq[k];
   stiffness(LANE_OF, &m, hq, hqq, 1);
   for (int i = 0; i < DOF; i++) {
      r[i] = dq[i] - v[i];
      for (int k = 0; k < DOF; k++) {
         r[i] += 0.5 * hpp[i * DOF + k] * hq[k];
         matrix[i * DOF + k] = i == k;
         for (int l = 0; l < DOF; l++)
            matrix[i * DOF + k] += 0.25 * hpp[i * DOF + l] * hqq[l * DOF + k];
      }
   }
   eliminate(matrix, r);
   for (int k = 0; k < DOF; k++) {
      s->q[k] += dq[k] - r[k];
      s->p[k] += z[k];
   }
}
