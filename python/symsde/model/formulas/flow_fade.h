
/* Factors of a step damped by one rate, z = gamma h: the parts that momenta lose, exp(-z) - 1 and exp(-z/2) - 1; and,
 * for two stages of Gauss with nodes c and coefficients a, the coefficients of the momenta (src/scheme/decays.f90)
 *
 *    d_i = exp(-c_i z) - 1,   a_ij exp(-(c_i - c_j) z),   b_j = exp(-(1 - c_j) z)/2
 *
 * Sweeps begin with momenta that have lost the part e_i = sum_j a_ij d_j/c_i, and end with momenta that have lost the
 * part (d_1 + d_2)/2. */
typedef struct {
   double leg[4], reach[4];                      /* drifts between kicks, leg_of of the step */
   double whole, half, d[2], a[2][2], b[2];      /* steps */
   double e[2], s[2][2], v[2], mean;             /* sweeps */
   double trace, det, v_1[2], v_c[2], b_1[2], b_d[2], b_c[2]; /* linear equations */
} fading;
static const double gauss2_a[2][2] = {{0.25, -0.038675134594812866}, {0.5386751345948129, 0.25}};
static const double gauss2_c[2] = {0.2113248654051871, 0.7886751345948129};
static const double leg_of[4] = {0.21132486540518711, 0.57735026918962577, 1, 0.5};

/* r of y (1 + s m)^{-1} x det(1 + s m) = r_0 + s r_1, where m has this trace */
LANE void fade_row(const double y[2], const double m[2][2], const double trace, const double x[2], double r[2]) {
   r[0] = y[0] * x[0] + y[1] * x[1];
   r[1] = trace * r[0] - y[0] * (m[0][0] * x[0] + m[0][1] * x[1]) - y[1] * (m[1][0] * x[0] + m[1][1] * x[1]);
}

/* From the functional of damped steps, whose exponentials the library computes once. */
LANE fading fade_of(const double *restrict given) {
   /* over the first node, between both nodes, over a step, its half and the second node; the parts lost, and those left */
   const double z = given[0], *const lost = given + 10, *const left = given + 15;
   fading f = {.whole = lost[2], .half = lost[3], .leg = {lost[0], lost[1], lost[2], lost[3]}, .d = {lost[0], lost[4]}};
   for (int i = 0; i < 4; i++)
      f.reach[i] = z == 0 ? leg_of[i] : -f.leg[i] / z;
   for (int i = 0; i < 2; i++) {
      f.b[i] = 0.5 * left[4 * (1 - i)];
      f.a[i][i] = gauss2_a[i][i];
   }
   f.a[1][0] = gauss2_a[1][0] * left[1];
   f.a[0][1] = gauss2_a[0][1] / left[1];
   f.mean = 0.5 * (f.d[0] + f.d[1]);
   double both_a[2][2]; /* coefficients a of positions times those of momenta */
   for (int i = 0; i < 2; i++) {
      f.e[i] = (gauss2_a[i][0] * f.d[0] + gauss2_a[i][1] * f.d[1]) / gauss2_c[i];
      f.v[i] = 0.5 * (f.a[0][i] + f.a[1][i]);
      for (int j = 0; j < 2; j++) {
         both_a[i][j] = gauss2_a[i][0] * f.a[0][j] + gauss2_a[i][1] * f.a[1][j];
         f.s[i][j] = both_a[i][j] / gauss2_c[i];
      }
   }
   /* rows v, b times (1 + x both_a)^{-1} times columns 1, d = a (1 + d), c */
   const double one[2] = {1, 1}, d[2] = {gauss2_c[0] * (1 + f.e[0]), gauss2_c[1] * (1 + f.e[1])};
   f.trace = both_a[0][0] + both_a[1][1];
   f.det = both_a[0][0] * both_a[1][1] - both_a[0][1] * both_a[1][0];
   fade_row(f.v, both_a, f.trace, one, f.v_1);
   fade_row(f.v, both_a, f.trace, gauss2_c, f.v_c);
   fade_row(f.b, both_a, f.trace, one, f.b_1);
   fade_row(f.b, both_a, f.trace, d, f.b_d);
   fade_row(f.b, both_a, f.trace, gauss2_c, f.b_c);
   return f;
}
