
/* gauss2 in mild steps, without matrices, for velocities linear in p: with G = S_q of both stages, c_i = sum_j a_ij,
 *
 *    G_i = S_q(q + c_i S_p(p - sum_k (a a)_ik/c_i G_k)),   q' = q + S_p(p - sum_k (1/2 1/2) a_k G_k),   p' = p - (G_1 + G_2)/2
 *
 * A sweep computes both stages, side by side, from the stages of the sweep before. If damped, p has lost its part
 * before each S_p, and the second a and the last 1/2 are coefficients of the momenta. */
#if DAMPED
#define gauss2_b fade.s
#define gauss2_v fade.v
#else
static const double gauss2_c[2] = {0.2113248654051871, 0.7886751345948129};
static const double gauss2_b[2][2] = {{0.19716878364870322, -0.09150635094610966},
                                      {0.34150635094610965, 0.05283121635129678}};
static const double gauss2_v[2] = {0.39433756729740643, 0.10566243270259355};
#endif
#define gauss2_SLOPES (2 * DOF)

/* The next slopes f of stage i from the slopes g of the sweep before; `first`: there is no sweep before. */
INLINE gauss2_sweep_of(LANE_IN, const int i, const state *s, const double *g, double *f, const int first) {
   state m = *s;
   lose(fade.e[i], &m);
   for (int k = 0; k < DOF; k++)
      if (!first)
         m.p[k] = FMA(-gauss2_b[i][1], g[DOF + k], FMA(-gauss2_b[i][0], g[k], m.p[k]));
   const int64_t beyond = drift(LANE_OF, &m, gauss2_c[i], 0);
   return beyond | force(LANE_OF, &m, f + i * DOF, 0);
}

INLINE gauss2_sweep(LANE_IN, const state *s, const double *g, double *f, const int first) {
   const int64_t beyond = gauss2_sweep_of(LANE_OF, 0, s, g, f, first);
   return beyond | gauss2_sweep_of(LANE_OF, 1, s, g, f, first);
}

INLINE gauss2_arrive(LANE_IN, state *s, const double *g) {
   state m = *s;
   lose(fade.mean, &m);
   for (int k = 0; k < DOF; k++)
      m.p[k] = FMA(-gauss2_v[1], g[DOF + k], FMA(-gauss2_v[0], g[k], m.p[k]));
   const int64_t beyond = drift(LANE_OF, &m, 1, 0);
   lose(fade.whole, s);
   for (int k = 0; k < DOF; k++) {
      s->q[k] = m.q[k];
#if DAMPED
      s->p[k] = FMA(-fade.b[1], g[DOF + k], FMA(-fade.b[0], g[k], s->p[k]));
#else
      s->p[k] = FMA(-0.5, g[k] + g[DOF + k], s->p[k]);
#endif
   }
   return beyond;
}
