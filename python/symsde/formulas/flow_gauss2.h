
/* Newton's correction of the slopes F_1, F_2, G_1, G_2 of both stages, S_qp = 0, DOF degrees of freedom each:
 *    (I + S_qq a S_pp a) dG = r_G - S_qq a r_F,   dF = r_F + S_pp a dG
 */
static const double gauss2_a[2][2] = {{0.25, -0.038675134594812866}, {0.5386751345948129, 0.25}};

INLINE gauss2_correction_at(LANE_IN, const state *s, const double *z, double *d, const int apart, const int far) {
   const double *const F = z, *const G = z + 2;
   double hq[2], hp[2], hqq[2], hqp[1], hpp[2];
   int64_t beyond = 0;
   for (int i = 0; i < 2; i++) {
      state m = *s;
      if (apart) {
         m.q[0] += gauss2_a[i][0] * F[0] + gauss2_a[i][1] * F[1];
         m.p[0] += gauss2_a[i][0] * G[0] + gauss2_a[i][1] * G[1];
      }
      beyond |= slopes(LANE_OF, &m, hq + i, hp + i, hqq + i, hqp, hpp + i, far);
   }
   double e[2][2], matrix[2][2], r[2], g[2];
   for (int i = 0; i < 2; i++)
      for (int j = 0; j < 2; j++)
         e[i][j] = gauss2_a[i][j] * hpp[j];
   for (int i = 0; i < 2; i++) {
      for (int j = 0; j < 2; j++)
         matrix[i][j] = (i == j) + hqq[i] * (e[i][0] * gauss2_a[0][j] + e[i][1] * gauss2_a[1][j]);
      r[i] = F[i] - hp[i];
   }
   for (int i = 0; i < 2; i++)
      g[i] = G[i] + hq[i] - hqq[i] * (gauss2_a[i][0] * r[0] + gauss2_a[i][1] * r[1]);
   const double inverse = 1 / (matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]);
   d[2] = (matrix[1][1] * g[0] - matrix[0][1] * g[1]) * inverse;
   d[3] = (matrix[0][0] * g[1] - matrix[1][0] * g[0]) * inverse;
   for (int i = 0; i < 2; i++)
      d[i] = r[i] + hpp[i] * (gauss2_a[i][0] * d[2] + gauss2_a[i][1] * d[3]);
   d[4] = 0;
   return beyond;
}

INLINE gauss2_correction(LANE_IN, const state *s, const double *z, double *d, const int far) {
   return gauss2_correction_at(LANE_OF, s, z, d, 1, far);
}

/* one correction with both stages at the beginning of the step */
INLINE gauss2_guess(LANE_IN, const state *s, double *z, const int far) {
   double d[5];
   for (int k = 0; k < 4; k++)
      z[k] = 0;
   const int64_t beyond = gauss2_correction_at(LANE_OF, s, z, d, 0, far);
   for (int k = 0; k < 4; k++)
      z[k] -= d[k];
   return beyond;
}

LANE void gauss2_increment(LANE_IN, const state *s, const double *z, double *dq, double *dp) {
   dq[0] = 0.5 * z[0] + 0.5 * z[1];
   dp[0] = 0.5 * z[2] + 0.5 * z[3];
}

#define gauss2_steep_increment gauss2_increment /* both unknowns are there */
