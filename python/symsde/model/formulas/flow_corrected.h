
/* The Euler pair of Hhat = S +- F_p.F_q/2, with F the noises' part of S, in increments form. S is separable, with
 * U = F_qq, V = F_pp. Symplectic Euler has the sign +, and is closed if V depends on the weights alone:
 *
 *    (1 + U V/2) p' = p - S_q(q) - U F_p(0)/2,   q' = q + V F_q(q)/2 + S_p(p')
 *
 * Its adjoint has the sign -, and is closed if U depends on the weights alone:
 *
 *    (1 + V U/2) q' = q + S_p(p) - V F_q(0)/2,   p' = p + U F_p(p)/2 - S_q(q')
 *
 * Momenta decay after symplectic Euler, and before its adjoint. */

/* x + part A y */
LANE void corrected_by(const double part, const double *a, const double *y, double *x) {
   for (int i = 0; i < DOF; i++)
      for (int k = 0; k < DOF; k++)
         x[i] = FMA(part * a[i * DOF + k], y[k], x[i]);
}

/* (1 + A B/2)^{-1} x in place of x */
LANE void corrected_end(const double *a, const double *b, double *x) {
   double m[DOF * DOF];
   for (int i = 0; i < DOF; i++)
      for (int k = 0; k < DOF; k++) {
         m[i * DOF + k] = i == k;
         for (int l = 0; l < DOF; l++)
            m[i * DOF + k] = FMA(0.5 * a[i * DOF + l], b[l * DOF + k], m[i * DOF + k]);
      }
   eliminate(m, x);
}

INLINE symplectic_euler_corrected(LANE_IN, state *s, const int far) {
   double f[DOF], v[DOF], u[DOF * DOF], k[DOF * DOF];
   int64_t beyond = noise_force(LANE_OF, s, f, u, far);
   state still = *s;
   for (int i = 0; i < DOF; i++)
      still.p[i] = 0;
   beyond |= noise_velocity(LANE_OF, &still, v, k, far);
   beyond |= kick(LANE_OF, s, 1, far);
   if (PUSHED)
      corrected_by(-0.5, u, v, s->p);
   corrected_end(u, k, s->p);
   corrected_by(0.5, k, f, s->q);
   beyond |= drift(LANE_OF, s, 1, far);
   lose(fade.whole, s);
   return beyond;
}

INLINE symplectic_euler_adjoint_corrected(LANE_IN, state *s, const int far) {
   double f[DOF], v[DOF], u[DOF * DOF], k[DOF * DOF];
   lose(fade.whole, s);
   int64_t beyond = noise_velocity(LANE_OF, s, v, k, far);
   state middle = *s;
   for (int i = 0; i < DOF; i++)
      middle.q[i] = 0;
   beyond |= noise_force(LANE_OF, &middle, f, u, far);
   beyond |= drift(LANE_OF, s, 1, far);
   if (PUSHED)
      corrected_by(-0.5, k, f, s->q);
   corrected_end(k, u, s->q);
   corrected_by(0.5, u, v, s->p);
   return beyond | kick(LANE_OF, s, 1, far);
}
