
/* Slopes F_1, F_2, G_1, G_2 of both stages, S_qp = 0, one degree of freedom; of each stage S_q, S_p, S_qq, S_pp. */
static const double gauss2_a[2][2] = {{0.25, -0.038675134594812866}, {0.5386751345948129, 0.25}};
#define gauss2_DERIVATIVES 8

INLINE gauss2_at(LANE_IN, const state *s, double *e, const int far) {
   double hqp[1];
   return slopes(LANE_OF, s, e, e + 1, e + 2, hqp, e + 3, far);
}

INLINE gauss2_evaluate(LANE_IN, const state *s, const double *z, double *e, const int far) {
   int64_t beyond = 0;
#pragma GCC unroll 2
   for (int i = 0; i < 2; i++) {
      state m = *s;
      m.q[0] = FMA(gauss2_a[i][1], z[1], FMA(gauss2_a[i][0], z[0], m.q[0]));
      m.p[0] = FMA(gauss2_a[i][1], z[3], FMA(gauss2_a[i][0], z[2], m.p[0]));
      beyond |= gauss2_at(LANE_OF, &m, e + 4 * i, far);
   }
   return beyond;
}

/* Newton's correction: (I + S_qq a S_pp a) dG = r_G - S_qq a r_F,   dF = r_F + S_pp a dG */
LANE void gauss2_correction(LANE_IN, const state *s, const double *z, const double *e, double *d) {
   (void)w, (void)n, (void)c, (void)h, (void)s;
   double matrix[2][2], r[2], g[2];
   for (int i = 0; i < 2; i++)
      r[i] = z[i] - e[4 * i + 1];
   for (int i = 0; i < 2; i++) {
      const double *const ai = gauss2_a[i], hqq = e[4 * i + 2];
      for (int j = 0; j < 2; j++) {
         const double both = FMA(ai[0] * e[3], gauss2_a[0][j], ai[1] * e[7] * gauss2_a[1][j]);
         matrix[i][j] = FMA(hqq, both, i == j ? 1.0 : 0.0);
      }
      g[i] = FMA(-hqq, FMA(ai[0], r[0], ai[1] * r[1]), z[2 + i] + e[4 * i]);
   }
   const double inverse = 1 / FMA(matrix[0][0], matrix[1][1], -(matrix[0][1] * matrix[1][0]));
   d[2] = FMA(matrix[1][1], g[0], -(matrix[0][1] * g[1])) * inverse;
   d[3] = FMA(matrix[0][0], g[1], -(matrix[1][0] * g[0])) * inverse;
   for (int i = 0; i < 2; i++)
      d[i] = FMA(e[4 * i + 3], FMA(gauss2_a[i][0], d[2], gauss2_a[i][1] * d[3]), r[i]);
   d[4] = 0;
}

/* one correction of zero, with both stages at the beginning of the step */
INLINE gauss2_guess(LANE_IN, const state *s, double *z, const int far) {
   const double zero[4] = {0, 0, 0, 0};
   double e[8], d[5];
   const int64_t beyond = gauss2_at(LANE_OF, s, e, far);
   for (int k = 0; k < 4; k++)
      e[4 + k] = e[k];
   gauss2_correction(LANE_OF, s, zero, e, d);
   for (int k = 0; k < 4; k++)
      z[k] = -d[k];
   return beyond;
}

LANE void gauss2_increment(LANE_IN, state *s, const double *z) {
   (void)w, (void)n, (void)c, (void)h;
   s->q[0] += FMA(0.5, z[0], 0.5 * z[1]);
   s->p[0] += FMA(0.5, z[2], 0.5 * z[3]);
}

#define gauss2_steep_increment gauss2_increment /* both unknowns are there */
