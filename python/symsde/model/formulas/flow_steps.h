/* SPDX-License-Identifier: BSD-3-Clause
 * Whole steps of one lane, from functions that are generated before this text: with S = sum_j w_j H_j,
 *
 *    force, velocity              S_q, S_p
 *    slopes                       S_q and S_p with S_qq, S_qp, S_pp
 *    kick, drift                  p - part S_q, q + part S_p
 *    places, fall                 what S_q takes from q alone, and p - part S_q by that
 *    kick_bound, fall_bound       kick and fall by the terms that depend on the state
 *    kick_free                    kick by those that do not
 *    glide                        q + part S_p(p + exp(-z) p)/2 where S_p is linear, for damped momenta
 *    coupling                     S_qp
 *    kick_by, fall_by, drift_by   d - part S_q, d - part S_q, d + part S_p
 *
 * DOF degrees of freedom; the weights of a lane stand n apart. With `far` = 1 a step computes arguments of any size;
 * with 0 it returns a negative number where some argument was far, as the functions do.
 */

LANE state state_of(const double *restrict x, const int i, const int kept) {
   state s;
   for (int k = 0; k < kept; k++)
      s.e[k] = x[(2 * DOF + k) * STRIP + i];
   for (int k = 0; k < DOF; k++) {
      s.q[k] = x[k * STRIP + i];
      s.p[k] = x[(DOF + k) * STRIP + i];
#if SPLIT
      s.d[k] = 0;
#endif
   }
   return s;
}

LANE void put_state(const state s, double *restrict x, const int i, const int kept) {
   for (int k = 0; k < kept; k++)
      x[(2 * DOF + k) * STRIP + i] = s.e[k];
   for (int k = 0; k < DOF; k++) {
      x[k * STRIP + i] = s.q[k];
      x[(DOF + k) * STRIP + i] = s.p[k];
   }
}

/* p + part p in place of p */
#if DAMPED
LANE void lose(const double part, state *s) {
   for (int k = 0; k < DOF; k++)
      s->p[k] = FMA(part, s->p[k], s->p[k]);
}
#else
#define lose(part, s)
#define kick_bound kick
#define fall_bound fall
#endif

#if EXPLICIT
/* Where q and p meet in products of both alone, S_qp depends on neither, and explicit schemes have a matrix to eliminate:
 *
 *    p' = p - a S_q(q, p + b (p' - p)) = p - a (1 + a b S_qp)^-1 S_q(q, p)          kick_at, fall_at
 *    q' = q + a S_p(q + b (q' - q), p) = q + a (1 - a b S_pq)^-1 S_p(q, p)          drift_at
 *
 * With S_qp = 0 these are kick, fall and drift. */
#if COUPLED
/* x + (1 + ab S_qp)^-1 d in place of x, or by the transposed matrix, whose entries stand `down` and `across` apart */
INLINE add_part(LANE_IN, const state *s, const double ab, const int down, const int across, double *restrict d,
                double *restrict x, const int far) {
   double hqp[DOF * DOF], matrix[DOF * DOF];
   const int64_t beyond = coupling(LANE_OF, s, hqp, far);
   for (int i = 0; i < DOF; i++)
      for (int j = 0; j < DOF; j++)
         matrix[i * DOF + j] = FMA(ab, hqp[i * down + j * across], i == j);
   eliminate(matrix, d);
   for (int i = 0; i < DOF; i++)
      x[i] += d[i];
   return beyond;
}

#define MOVE_AT(move, ab, down, across, x)                                                                           \
   INLINE move##_at(LANE_IN, state *s, const double a, const double b, const int far) {                              \
      double d[DOF] = {0};                                                                                           \
      const int64_t beyond = move##_by(LANE_OF, s, d, a, far);                                                       \
      return beyond | add_part(LANE_OF, s, ab, down, across, d, x, far);                                             \
   }
MOVE_AT(kick, (a * b), 1, DOF, s->p)
MOVE_AT(fall, (a * b), 1, DOF, s->p)
MOVE_AT(drift, (-a * b), DOF, 1, s->q)
#else
#define kick_at(lane, s, a, b, far) kick(lane, s, a, far)
#define fall_at(lane, s, a, b, far) fall(lane, s, a, far)
#define drift_at(lane, s, a, b, far) drift(lane, s, a, far)
#endif

/* p' = p - S_q(q, p'), q' = q + S_p(q, p') */
INLINE symplectic_euler(LANE_IN, state *s, const int far) {
   int64_t beyond = kick_at(LANE_OF, s, 1, 1, far);
   beyond |= drift(LANE_OF, s, 1, far);
   lose(fade.whole, s);
   return beyond;
}

/* q' = q + S_p(q', p), p' = p - S_q(q', p) */
INLINE symplectic_euler_adjoint(LANE_IN, state *s, const int far) {
   lose(fade.whole, s);
   const int64_t beyond = drift_at(LANE_OF, s, 1, 1, far);
   return beyond | kick(LANE_OF, s, 1, far);
}

#if DAMPED
/* Between two kicks the momenta p decay to (p + other) + part p: with S_q = n + f, where n does not depend on the state, the
 * second kick takes its n from the momenta before the decay, beside the first kick's f. So the second kick waits for its
 * own f and for one operation of the decay, as without damping. */
LANE state kicked_ahead(const state *s, const state *free) {
   state ahead = *s;
   for (int k = 0; FREE_KICKS && k < DOF; k++)
      ahead.p[k] += free->p[k];
   return ahead;
}

/* ahead + part p in place of p */
LANE void lose_beside(const double part, const state *ahead, state *s) {
   for (int k = 0; k < DOF; k++)
      s->p[k] = FMA(part, s->p[k], ahead->p[k]);
}
#endif

/* half a kick, a drift, half a kick; half of the drift of damped momenta is by their remaining part */
INLINE stormer_verlet(LANE_IN, state *s, const int far) {
#if DAMPED
   state free = {{0}, {0}};
   kick_free(LANE_OF, &free, 1, far);
   state ahead = kicked_ahead(s, &free);
   fall_bound(LANE_OF, &ahead, 0.5, far);
#endif
   int64_t beyond = fall_at(LANE_OF, s, 0.5, 1, far);
#if DAMPED
#if GLIDES
   beyond |= glide(LANE_OF, s, 1, far);
#else
   beyond |= drift(LANE_OF, s, 0.5, far);
   state lost = *s;
   lose(fade.whole, &lost);
   beyond |= drift(LANE_OF, &lost, 0.5, far);
   memcpy(s->q, lost.q, sizeof s->q);
#endif
   lose_beside(fade.whole, &ahead, s);
#else
   beyond |= drift_at(LANE_OF, s, 1, 0.5, far);
#endif
   beyond |= places(LANE_OF, s, s->e, far);
   return beyond | fall_bound(LANE_OF, s, 0.5, far);
}

/* half a drift, a kick, half a drift; of damped momenta half of the kick decays with them */
INLINE lobatto2_swapped(LANE_IN, state *s, const int far) {
   int64_t beyond = drift_at(LANE_OF, s, 0.5, 1, far);
   lose(fade.whole, s);
#if DAMPED
   beyond |= kick(LANE_OF, s, FMA(0.5, fade.whole, 1), far);
#else
   beyond |= kick_at(LANE_OF, s, 1, 0.5, far);
#endif
   return beyond | drift(LANE_OF, s, 0.5, far);
}
#endif

/* the mean of the slopes at the state and at the end of an explicit step; the force of damped momenta that decays is that
 * at the state */
#if !SPLIT
INLINE heun(LANE_IN, state *s, const int far) {
   state end = *s;
   double f[DOF], v[DOF], g[DOF], u[DOF];
   int64_t beyond = force(LANE_OF, s, f, far) | velocity(LANE_OF, s, v, far);
   for (int k = 0; k < DOF; k++) {
      end.q[k] += v[k];
      end.p[k] -= f[k];
   }
   lose(fade.whole, &end);
   beyond |= force(LANE_OF, &end, g, far) | velocity(LANE_OF, &end, u, far);
#if DAMPED
   lose(fade.whole, s);
   for (int k = 0; k < DOF; k++)
      f[k] = FMA(fade.whole, f[k], f[k]);
#endif
   for (int k = 0; k < DOF; k++) {
      s->q[k] = FMA(0.5, v[k] + u[k], s->q[k]);
      s->p[k] = FMA(-0.5, f[k] + g[k], s->p[k]);
   }
   return beyond;
}
#endif
