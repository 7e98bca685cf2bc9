
/* Unknowns: slopes F_1, F_2, G_1, G_2 of both stages. Derivatives of each stage: S_q, S_p, S_qq, S_pp; S_qp = 0. */
#if DAMPED
#define gauss2_p(i, j) fade.a[i][j]
#else
static const double gauss2_a[2][2] = {{0.25, -0.038675134594812866}, {0.5386751345948129, 0.25}};
#define gauss2_p(i, j) gauss2_a[i][j] /* in momenta */
#endif
enum { OF_STAGE = 2 * DOF + 2 * DOF * DOF, IN_PP = 2 * DOF + DOF * DOF };
#define gauss2_DERIVATIVES (2 * OF_STAGE)

INLINE gauss2_at(LANE_IN, const state *s, double *e, const int far) {
   double hqp[DOF * DOF];
   return slopes(LANE_OF, s, e, e + DOF, e + 2 * DOF, hqp, e + IN_PP, far);
}

INLINE gauss2_evaluate(LANE_IN, const state *s, const double *z, double *e, const int far) {
   int64_t beyond = 0;
#pragma GCC unroll 2
   for (int i = 0; i < 2; i++) {
      state m = *s;
      lose(fade.d[i], &m);
#pragma GCC unroll 4
      for (int k = 0; k < DOF; k++) {
         m.q[k] = FMA(gauss2_a[i][1], z[DOF + k], FMA(gauss2_a[i][0], z[k], m.q[k]));
         m.p[k] = FMA(gauss2_p(i, 1), z[3 * DOF + k], FMA(gauss2_p(i, 0), z[2 * DOF + k], m.p[k]));
      }
      beyond |= gauss2_at(LANE_OF, &m, e + OF_STAGE * i, far);
   }
   return beyond;
}

/* Block (i, j) of I + S_qq a S_pp a for stages i and j. */
LANE void gauss2_block(LANE_IN, const double *hqq, const double *pp, const double *pp2, const int i, const int j,
                       double *matrix) {
   (void)w, (void)n, (void)c, (void)h;
#pragma GCC unroll 4
   for (int l = 0; l < DOF; l++) {
      double both[DOF];
#pragma GCC unroll 4
      for (int m = 0; m < DOF; m++)
         both[m] = FMA(gauss2_a[i][0] * pp[m * DOF + l], gauss2_p(0, j),
                       gauss2_a[i][1] * pp2[m * DOF + l] * gauss2_p(1, j));
#pragma GCC unroll 4
      for (int k = 0; k < DOF; k++) {
         double entry = i == j && k == l ? 1.0 : 0.0;
#pragma GCC unroll 4
         for (int m = 0; m < DOF; m++)
            entry = FMA(hqq[k * DOF + m], both[m], entry);
         matrix[(i * DOF + k) * 2 * DOF + j * DOF + l] = entry;
      }
   }
}

/* Replace g by matrix^{-1} g. */
LANE void gauss2_solve(double *matrix, double *g) {
#if DOF == 1
   const double inverse = 1 / FMA(matrix[0], matrix[3], -(matrix[1] * matrix[2])), first = g[0];
   g[0] = FMA(matrix[3], first, -(matrix[1] * g[1])) * inverse;
   g[1] = FMA(matrix[0], g[1], -(matrix[2] * first)) * inverse;
#else
   eliminate_both(matrix, g);
#endif
}

/* Newton's correction: (I + S_qq a S_pp a) dG = r_G - S_qq a r_F,   dF = r_F + S_pp a dG; damped: the second a, of momenta */
LANE void gauss2_correction(LANE_IN, const state *s, const double *z, const double *e, double *d) {
   (void)w, (void)n, (void)c, (void)h, (void)s;
   double matrix[4 * DOF * DOF], r[2 * DOF];
   double *const g = d + 2 * DOF;
   const double *const pp = e + IN_PP, *const pp2 = e + OF_STAGE + IN_PP;
#pragma GCC unroll 4
   for (int k = 0; k < DOF; k++) {
      r[k] = z[k] - e[DOF + k];
      r[DOF + k] = z[DOF + k] - e[OF_STAGE + DOF + k];
   }
#pragma GCC unroll 2
   for (int i = 0; i < 2; i++) {
      const double *const hq = e + OF_STAGE * i, *const hqq = hq + 2 * DOF;
      gauss2_block(LANE_OF, hqq, pp, pp2, i, 0, matrix);
      gauss2_block(LANE_OF, hqq, pp, pp2, i, 1, matrix);
#pragma GCC unroll 4
      for (int k = 0; k < DOF; k++) {
         double sum = z[(2 + i) * DOF + k] + hq[k];
#pragma GCC unroll 4
         for (int m = 0; m < DOF; m++)
            sum = FMA(-hqq[k * DOF + m], FMA(gauss2_a[i][0], r[m], gauss2_a[i][1] * r[DOF + m]), sum);
         g[i * DOF + k] = sum;
      }
   }
   gauss2_solve(matrix, g);
#pragma GCC unroll 2
   for (int i = 0; i < 2; i++) {
      const double *const hpp = i == 0 ? pp : pp2;
#pragma GCC unroll 4
      for (int k = 0; k < DOF; k++) {
         double sum = r[i * DOF + k];
#pragma GCC unroll 4
         for (int m = 0; m < DOF; m++)
            sum = FMA(hpp[k * DOF + m], FMA(gauss2_p(i, 0), g[m], gauss2_p(i, 1) * g[DOF + m]), sum);
         d[i * DOF + k] = sum;
      }
   }
   d[4 * DOF] = 0;
}

/* one correction from zero, with both stages at the beginning of the step, and momenta of its middle */
INLINE gauss2_guess(LANE_IN, const state *s, double *z, const int far) {
   double zero[4 * DOF], e[gauss2_DERIVATIVES], d[4 * DOF + 1];
   state m = *s;
   lose(fade.half, &m);
   const int64_t beyond = gauss2_at(LANE_OF, &m, e, far);
#pragma GCC unroll 40
   for (int k = 0; k < OF_STAGE; k++)
      e[OF_STAGE + k] = e[k];
   for (int k = 0; k < 4 * DOF; k++)
      zero[k] = 0;
   gauss2_correction(LANE_OF, s, zero, e, d);
   for (int k = 0; k < 4 * DOF; k++)
      z[k] = -d[k];
   return beyond;
}

LANE void gauss2_increment(LANE_IN, state *s, const double *z) {
   (void)w, (void)n, (void)c, (void)h;
   lose(fade.whole, s);
   for (int k = 0; k < DOF; k++) {
      s->q[k] += FMA(0.5, z[k], 0.5 * z[DOF + k]);
#if DAMPED
      s->p[k] += FMA(fade.b[0], z[2 * DOF + k], fade.b[1] * z[3 * DOF + k]);
#else
      s->p[k] += FMA(0.5, z[2 * DOF + k], 0.5 * z[3 * DOF + k]);
#endif
   }
}

#define gauss2_steep_increment gauss2_increment /* F and G are both unknowns */
