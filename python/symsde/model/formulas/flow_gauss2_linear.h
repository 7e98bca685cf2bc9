
/* Quadratic Hamiltonians of one degree of freedom with S_qp = 0: with a = S_qq, k = S_pp, d = 1 - a k/12,
 * D = d^2 + a k/4, and f, g the gradient at zero:
 *
 *    q' = q + (k (d p - a q/2) + d g - k f/2)/D,   p' = p - (a (d q + k p/2) + d f + a g/2)/D
 *
 * If damped, with x = a k, B the product of the coefficients a of positions and of momenta, and rows v, b and columns
 * 1, d, c as in fade_of,
 *
 *    G = -(1 + x B)^{-1} ((a q + f) 1 + x p d + a g c),   q' = q + (1 + mean) k p + g + k v G,   p' = exp(-z) p + b G
 *
 * where k p in q' and -a q in p' have the same factor, since the scheme is symmetric. */
INLINE gauss2_coefficients(LANE_IN, double *restrict m, const int far) {
   const state zero = {{0}, {0}, {0}};
   double f[1], g[1], hqq[1], hqp[1], hpp[1];
   const int64_t beyond = slopes(LANE_OF, &zero, f, g, hqq, hqp, hpp, far);
#if DAMPED
   const double x = hqq[0] * hpp[0], inverse = 1 / FMA(x, FMA(x, fade.det, fade.trace), 1.0);
   const double part = FMA(x, fade.b_1[1], fade.b_1[0]) * inverse, v_1 = FMA(x, fade.v_1[1], fade.v_1[0]);
   m[0] = -(x * inverse) * v_1;
   m[1] = hpp[0] * part;
   m[2] = -hqq[0] * part;
   m[3] = FMA(-(x * inverse), FMA(x, fade.b_d[1], fade.b_d[0]), fade.whole);
   m[4] = m[5] = 0;
#if MOVES
   m[4] = FMA(g[0], FMA(-(x * inverse), FMA(x, fade.v_c[1], fade.v_c[0]), 1.0), -(hpp[0] * inverse * v_1) * f[0]);
   m[5] = -FMA(part, f[0], hqq[0] * inverse * FMA(x, fade.b_c[1], fade.b_c[0]) * g[0]);
#endif
#else
   const double both = hqq[0] * hpp[0], d = FMA(both, -0.08333333333333333, 1.0);
   const double inverse = 1 / FMA(d, d, 0.25 * both), part = d * inverse, half = 0.5 * inverse;
   m[0] = -both * half;
   m[1] = hpp[0] * part;
   m[2] = -hqq[0] * part;
   m[3] = m[0];
   m[4] = FMA(part, g[0], -(hpp[0] * half) * f[0]);
   m[5] = -FMA(part, f[0], hqq[0] * half * g[0]);
#endif
   return beyond;
}

LANE void gauss2_turn(const double *m, state *s) {
   const double q = s->q[0], p = s->p[0];
#if MOVES
   s->q[0] = FMA(m[1], p, q) + FMA(m[0], q, m[4]);
   s->p[0] = FMA(m[2], q, p) + FMA(m[3], p, m[5]);
#else
   s->q[0] = FMA(m[0], q, FMA(m[1], p, q));
   s->p[0] = FMA(m[3], p, FMA(m[2], q, p));
#endif
}

INLINE gauss2(LANE_IN, state *s, const int far) {
   double m[COEFFICIENTS];
   const int64_t beyond = gauss2_coefficients(LANE_OF, m, far);
   gauss2_turn(m, s);
   return beyond;
}
