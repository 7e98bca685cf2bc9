
/* Kicks between drifts, noise in position (src/scheme/kicks.f90): w holds the weights of all kicks, one after the other,
 * and each of two kicks has half of the potential. Damped, a drift over the part c of a step moves by (1 - exp(-c z))/z
 * of it. */
static const double gauss_dkdkd_law[4] = {0.5, 0.5, 1.7320508075688772, -1.7320508075688772};
static const double verlet_kdk_law[4] = {0.5, 0.5, 1, -1};
static const double chin4a_law[1] = {0}; /* its weights are fixed, but for those of damped steps */
#if !DAMPED
static const double leg_of[4] = {0.21132486540518711, 0.57735026918962577, 1, 0.5};
#endif

#if SPLIT
/* Drift number `leg` is the flow of a quadratic part, z + X z of z = (q, p), here after a kick d: z + X z + (1 + X)(0, d).
 * What depends on the kick comes last, since a step waits for it. Kicks are those of H at p = 0, less the part's own
 * force S_qq q. */
#define KICKED d

LANE void turn(const double *restrict x, const int kicked, state *s) {
   state old = *s;
   for (int i = 0; i < ROW; i++) {
      double a = i < DOF ? old.q[i] : old.p[i - DOF], b = 0;
      for (int j = 0; j < DOF; j++) {
         a = FMA(x[i * ROW + j], old.q[j], a);
         b = FMA(x[i * ROW + DOF + j], old.p[j], b);
      }
      a += b;
      if (kicked) {
         if (i >= DOF)
            a += old.d[i - DOF];
         for (int j = 0; j < DOF; j++)
            a = FMA(x[i * ROW + DOF + j], old.d[j], a);
      }
      *(i < DOF ? s->q + i : s->p + i - DOF) = a;
   }
   for (int j = 0; j < DOF; j++)
      s->d[j] = 0;
}

/* p + d in place of p, after a kick at the end of a step */
LANE void settle(state *s) {
   for (int j = 0; j < DOF; j++) {
      s->p[j] += s->d[j];
      s->d[j] = 0;
   }
}

/* the slope f and the curvature k of a kick without those of the quadratic part */
LANE void soften(const double h, const double *restrict stiffness, const state *s, double *restrict f,
                 double *restrict k) {
   for (int i = 0; i < DOF * DOF; i++) {
      f[i / DOF] = FMA(-h * stiffness[i], s->q[i % DOF], f[i / DOF]);
      k[i] = FMA(-h, stiffness[i], k[i]);
   }
}
#else
#define KICKED p
#define settle(s)
#define soften(h, stiffness, s, f, k)
#endif

INLINE leap(LANE_IN, state *s, const int leg, const int far) {
#if DAMPED
   const int64_t beyond = drift(LANE_OF, s, fade.reach[leg], far);
   lose(fade.leg[leg], s);
   return beyond;
#elif SPLIT
   turn(D.flow + (leg > 1 ? 1 : leg) * ROW * ROW, 1, s); /* drifts outside of kicks at the ends are none */
   return 0;
#else
   return drift(LANE_OF, s, leg_of[leg], far);
#endif
}

#if DAMPED
/* The momenta before the first of two kicks, less what both take without looking at the state. */
LANE state ahead_of(LANE_IN, const state *s, const int far) {
   state free = {{0}, {0}};
   kick_free(w, n, c, 0.5 * h FADE, &free, 1, far);
   kick_free(w + NHAM * n, n, c, 0.5 * h FADE, &free, 1, far);
   return kicked_ahead(s, &free);
}

/* A drift between these kicks: the second one acts on the momenta ahead, too. */
INLINE leap_beside(LANE_IN, state *s, const int leg, const state *ahead, const int far) {
   const int64_t beyond = drift(LANE_OF, s, fade.reach[leg], far);
   lose_beside(fade.leg[leg], ahead, s);
   return beyond;
}
#else
#define leap_beside(lane, s, leg, ahead, far) leap(lane, s, leg, far)
#endif

INLINE gauss_dkdkd(LANE_IN, state *s, const int far) {
#if SPLIT
   int64_t beyond = 0;
   turn(D.flow, 0, s);
#else
   int64_t beyond = leap(LANE_OF, s, 0, far);
#endif
#if DAMPED
   state ahead = ahead_of(LANE_OF, s, far);
   kick_bound(w, n, c, 0.5 * h FADE, &ahead, 1, far);
#endif
   beyond |= kick(w, n, c, 0.5 * h FADE, s, 1, far);
   beyond |= leap_beside(LANE_OF, s, 1, &ahead, far);
   beyond |= kick_bound(w + NHAM * n, n, c, 0.5 * h FADE, s, 1, far);
   return beyond | leap(LANE_OF, s, 0, far);
}

/* p - part h |h| sum_k H_k,qq M^-1 H_k,q: what kicks add for the mean of the second Magnus term of noises */
INLINE push(LANE_IN, state *s, const double part, const int far) {
   int64_t beyond = 0;
#if BENT
   double f[DOF];
   beyond = bend(LANE_OF, s, f, far);
   for (int i = 0; i < DOF; i++)
      s->KICKED[i] = FMA(-part * h * fabs(h), f[i], s->KICKED[i]);
#endif
   return beyond;
}

INLINE verlet_kdk(LANE_IN, state *s, const int far) {
#if DAMPED
   state ahead = ahead_of(LANE_OF, s, far);
   fall_bound(w, n, c, 0.5 * h FADE, &ahead, 1, far);
   push(LANE_OF, &ahead, 1 / 12.0, far);
#endif
   int64_t beyond = fall(w, n, c, 0.5 * h FADE, s, 1, far);
   beyond |= push(LANE_OF, s, 1 / 12.0, far);
   beyond |= leap_beside(LANE_OF, s, 2, &ahead, far);
   beyond |= places(LANE_OF, s, s->e, far);
   beyond |= fall_bound(w + NHAM * n, n, c, 0.5 * h FADE, s, 1, far);
   beyond |= push(LANE_OF, s, 1 / 12.0, far);
   settle(s);
   return beyond;
}

/* The kick in the middle is by two thirds of h U - (h^3/48) U_q.M^-1 U_q, with V = h U + sum_k v_k H_k in the square. */
INLINE chin4a(LANE_IN, state *s, const int far) {
   double f[DOF], k[DOF * DOF], m[DOF * DOF], v[DOF];
   int64_t beyond = kick(w, n, c, (1 / 6.0) * h FADE, s, 1, far);
   beyond |= leap(LANE_OF, s, 3, far);
   beyond |= bow(w + 3 * NHAM * n, n, c, h FADE, s, f, k, far) | lever(LANE_OF, s, m, far);
   soften(h, D.stiffness, s, f, k);
   beyond |= kick(w + NHAM * n, n, c, (2 / 3.0) * h FADE, s, 1, far);
   beyond |= push(LANE_OF, s, 1 / 15.0, far);
   for (int i = 0; i < DOF; i++) {
      v[i] = 0;
      for (int j = 0; j < DOF; j++)
         v[i] = FMA(m[i * DOF + j], f[j], v[i]);
   }
   for (int i = 0; i < DOF; i++)
      for (int j = 0; j < DOF; j++)
         s->KICKED[i] = FMA((1 / 36.0) * k[i * DOF + j], v[j], s->KICKED[i]);
   beyond |= leap(LANE_OF, s, 3, far);
   beyond |= kick(w + 2 * NHAM * n, n, c, (1 / 6.0) * h FADE, s, 1, far);
   settle(s);
   return beyond;
}

/* The weights of three kicks and of V, from K, too: 4 (dW/24 + K) +- a, 8 (dW/12 - K), dW - 12 K. Damped, those of kicks
 * are beta dW + gamma a + eta K, with three of each in `law`. */
LANE void weigh_three(const int lanes, const double h, const double *restrict w, const double *restrict z,
                      const double *restrict kk, const ptrdiff_t n, const double *restrict law, double *restrict u,
                      const ptrdiff_t m) {
   const double inverse = 1 / h;
   for (int k = 1; k < NHAM; k++)
#pragma GCC ivdep
      for (int i = 0; i < lanes; i++) {
         const double dw = w[k * n + i], a = FMA(z[(k - 1) * n + i], inverse, -0.5 * dw), b = kk[(k - 1) * n + i];
#if DAMPED
         for (int j = 0; j < 3; j++)
            u[(j * NHAM + k) * m + i] = FMA(law[6 + j], b, FMA(law[3 + j], a, law[j] * dw));
#else
         const double ends = FMA(4, b, (1 / 6.0) * dw);
         u[k * m + i] = ends + a;
         u[(NHAM + k) * m + i] = FMA(-8, b, (2 / 3.0) * dw);
         u[(2 * NHAM + k) * m + i] = ends - a;
#endif
         u[(3 * NHAM + k) * m + i] = FMA(-12, b, dw);
      }
}

/* The weights u of kicks from those of a step and dZ: beta dW + gamma a, a = dZ/h - dW/2; rows of u stand m apart. */
LANE void weigh_two(const int lanes, const double h, const double *restrict w, const double *restrict z,
                    const double *restrict kk, const ptrdiff_t n, const double *restrict law, double *restrict u,
                    const ptrdiff_t m) {
   (void)kk;
   const double inverse = 1 / h;
   for (int k = 1; k < NHAM; k++)
#pragma GCC ivdep
      for (int i = 0; i < lanes; i++) {
         const double dw = w[k * n + i], a = FMA(z[(k - 1) * n + i], inverse, -0.5 * dw);
         u[k * m + i] = FMA(law[2], a, law[0] * dw);
         u[(NHAM + k) * m + i] = FMA(law[3], a, law[1] * dw);
      }
}
