
/* For quadratic Hamiltonians of one degree of freedom a step is z' = z + m z + z0, where m and z0 depend on the weights
 * alone: with a = S_qq/2, b = S_qp/2, k = S_pp/2, and f, g the gradient at zero,
 *
 *    (1 - b^2 + a k) m = [2 b (1 + b) - 2 a k,  2 k;  -2 a,  -2 b (1 - b) - 2 a k]
 *    (1 - b^2 + a k) z0 = [(1 + b) g - k f,  -(1 - b) f - a g]
 *
 * If damped, with E = exp(-z/2), the column of p in 1 + m gets the factor E, and so do the rows of p' in 1 + m and z0.
 *
 * A step waits for one product and one or two sums of the step before. If S_qp = 0, the step is, with D = 1 + a k,
 *
 *    q' = q + 2 k/D (p - a q) + z0_q,   p' = p - 2 a/D (q + k p) + z0_p. */
enum { COEFFICIENTS = 6, WANTED = MOVES ? 6 : 4 };

INLINE midpoint_coefficients(LANE_IN, double *restrict m, const int far) {
   const state zero = {{0}, {0}, {0}};
   double f[1], g[1], hqq[1], hqp[1], hpp[1];
   const int64_t beyond = slopes(LANE_OF, &zero, f, g, hqq, hqp, hpp, far);
   const double a = 0.5 * hqq[0], k = 0.5 * hpp[0];
#if DAMPED && !MIXED
   const double inverse = 1 / FMA(a, k, 1.0), less = inverse + fade.half * inverse;
   m[0] = -a * hpp[0] * inverse;
   m[1] = hpp[0] * less;
   m[2] = -hqq[0] * less;
   m[3] = FMA(m[0], 1 + fade.whole, fade.whole);
   m[4] = MOVES ? FMA(-k, f[0], g[0]) * inverse : 0;
   m[5] = MOVES ? FMA(-a, g[0], -f[0]) * less : 0;
#elif MIXED
   const double b = 0.5 * hqp[0], inverse = 1 / FMA(a, k, FMA(-b, b, 1.0));
   const double turn = 2 * b * inverse;
   m[1] = hpp[0] * inverse;
   m[2] = -hqq[0] * inverse;
   m[0] = FMA(turn, 1 + b, -a * m[1]);
   m[3] = FMA(turn, b - 1, k * m[2]);
   m[4] = FMA(1 + b, g[0], -k * f[0]) * inverse;
   m[5] = FMA(b - 1, f[0], -a * g[0]) * inverse;
#if DAMPED
   m[1] = FMA(m[1], fade.half, m[1]);
   m[2] = FMA(m[2], fade.half, m[2]);
   m[3] = FMA(m[3], fade.whole, m[3]) + fade.whole;
   m[5] = FMA(m[5], fade.half, m[5]);
#endif
#else
   const double inverse = 1 / FMA(a, k, 1.0);
   m[1] = hpp[0] * inverse;
   m[2] = -hqq[0] * inverse;
   m[0] = -a;
   m[3] = k;
   m[4] = FMA(-k, f[0], g[0]) * inverse;
   m[5] = FMA(-a, g[0], -f[0]) * inverse;
#endif
   return beyond;
}

LANE void midpoint_turn(const double *m, state *s) {
   const double q = s->q[0], p = s->p[0];
#if (MIXED || DAMPED) && !MOVES
   s->q[0] = FMA(m[0], q, FMA(m[1], p, q));
   s->p[0] = FMA(m[3], p, FMA(m[2], q, p));
#elif MIXED || DAMPED
   s->q[0] = FMA(m[1], p, q) + FMA(m[0], q, m[4]);
   s->p[0] = FMA(m[2], q, p) + FMA(m[3], p, m[5]);
#elif MOVES
   s->q[0] = FMA(m[1], FMA(m[0], q, p), q + m[4]);
   s->p[0] = FMA(m[2], FMA(m[3], p, q), p + m[5]);
#else
   s->q[0] = FMA(m[1], FMA(m[0], q, p), q);
   s->p[0] = FMA(m[2], FMA(m[3], p, q), p);
#endif
}

INLINE midpoint(LANE_IN, state *s, const int far) {
   double m[COEFFICIENTS];
   const int64_t beyond = midpoint_coefficients(LANE_OF, m, far);
   midpoint_turn(m, s);
   return beyond;
}
