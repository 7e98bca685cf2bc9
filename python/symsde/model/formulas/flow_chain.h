
/* ---- whole steps of chains ----
 *
 * Kicks between drifts, by rows: a strip of eight lanes keeps its states in the nearest cache through all steps of a
 * call, and a kick and the drift after it are one pass over the rows. Of a single lane, rows are computed side by side.
 * Kick i (src/scheme/kicks.f90, base/maps.f90) is
 *
 *    p <- p - (sum_j w_ij H_j)_q - share_i sum_k D_kk H_k,qq H_k,q - 2 kappa_i h V_qq V_q
 *    w_i0 = b_i h,   w_ik = beta_i dW_k + gamma_i a_k + eta_i K_k,   a_k = dZ_k/h - dW_k/2
 *    V = h H + sum_k v_k H_k,   v_k = dW_k + zeta K_k
 *
 * where each noise with a second derivative touches one site (MEAN). In the mean form D_kk = mean h |h|. Where J is
 * drawn (samples), and each site has one noise, with kappa = sum_i kappa_i,
 *
 *    D_kk = h [ sum_i<j (c_j - c_i) w_ik w_jk - 2 kappa v_k^2 ] - J_kk
 *
 * A drift moves q by reach h p, then momenta lose a part; damped, as flow_fade.h says. Generated before this text:
 * row_force, row_product and row_bend of a row and the next one, or of the last one by itself (CLOSED is 0), weights v
 * of the TERMS, column of each. */

#include <string.h>
enum { LANES_OF_STRIP = 8, DAMPED_STEP = 5 };
enum { BY_W, BY_Z, BY_K }; /* functionals that weigh kicks: dW; dZ, too; K, too */
/* Aims of a sweep: forces are kept, or products; or a kick acts, with further products, or with D_kk, too. */
enum { SLOPE, PRODUCT, KICK, KICK_MORE, KICK_DRAWN };
#define SITE(i) ((i) * (ptrdiff_t)lanes)

typedef struct {
   int kicks, uses;
   double c[3], b[3], beta[3], gamma[3], eta[3], kappa[3], share[3], mean, zeta;
   int samples;
} splitting;

/* The record of a step: its weights, dZ, K and J of one strip, whose columns are n apart. */
typedef struct {
   const double *w, *z, *k, *j;
   double h, inverse;
   ptrdiff_t n;
} record;

/* A sweep over rows: weights, and what happens to momenta and positions behind them. */
typedef struct {
   double b, beta, gamma, eta, mean, more, reach, loss;
} kick_of;

static const splitting of_symplectic_euler = {1, BY_W, {0}, {1}, {1}};
static const splitting of_symplectic_euler_adjoint = {1, BY_W, {1}, {1}, {1}};
static const splitting of_stormer_verlet = {2, BY_W, {0, 1}, {0.5, 0.5}, {0.5, 0.5}};
static const splitting of_verlet_kdk = {.kicks = 2, .uses = BY_Z, .c = {0, 1}, .b = {0.5, 0.5}, .beta = {0.5, 0.5},
                                        .gamma = {1, -1}, .share = {0.5, 0.5}, .mean = 1 / 6.0};
static const splitting of_gauss_dkdkd = {.kicks = 2, .uses = BY_Z, .c = {0.21132486540518711, 0.78867513459481287},
                                         .b = {0.5, 0.5}, .beta = {0.5, 0.5}, .share = {0.5, 0.5},
                                         .gamma = {1.7320508075688772, -1.7320508075688772}};
static const splitting of_chin4a = {.kicks = 3, .uses = BY_K, .c = {0, 0.5, 1}, .b = {1 / 6.0, 2 / 3.0, 1 / 6.0},
                                    .beta = {1 / 6.0, 2 / 3.0, 1 / 6.0}, .gamma = {1, 0, -1}, .eta = {4, -8, 4},
                                    .kappa = {0, -1 / 72.0, 0}, .share = {0, 1, 0}, .mean = 1 / 15.0, .zeta = -12};

/* The weights of the terms in one lane of a row. */
LANE void weights_of(const int uses, const record g, const kick_of k, const ptrdiff_t row, const ptrdiff_t sites,
                     const ptrdiff_t i, double *v) {
   for (int j = 0; j < TERMS; j++) {
      const ptrdiff_t at = column(j, row, sites);
      if (at == 0) {
         v[j] = k.b * g.h;
         continue;
      }
      const double dw = g.w[at * g.n + i];
      v[j] = k.beta * dw;
      if (uses >= BY_Z)
         v[j] = FMA(k.gamma, FMA(g.z[(at - 1) * g.n + i], g.inverse, -0.5 * dw), v[j]);
      if (uses >= BY_K)
         v[j] = FMA(k.eta, g.k[(at - 1) * g.n + i], v[j]);
   }
}

/* D_kk of all rows of a strip, each with one noise. */
LANE void draw_second(const int lanes, const int uses, const splitting *of, const record g, const kick_of *kicks,
                      const kick_of all, const ptrdiff_t sites, double *restrict d) {
   const double kappa = of->kappa[0] + of->kappa[1] + of->kappa[2];
   for (ptrdiff_t row = 0; row < sites; row++)
#pragma GCC ivdep
      for (int i = 0; i < lanes; i++) {
         double w[3], sum = 0;
         const double dw = g.w[(row + 1) * g.n + i], a = FMA(g.z[row * g.n + i], g.inverse, -0.5 * dw);
         const double k = uses >= BY_K ? g.k[row * g.n + i] : 0, v = FMA(all.eta, k, dw);
         for (int j = 0; j < 3; j++)
            w[j] = j < of->kicks ? FMA(kicks[j].eta, k, FMA(kicks[j].gamma, a, kicks[j].beta * dw)) : 0;
         sum = FMA(of->c[1] - of->c[0], w[0] * w[1], sum);
         sum = FMA(of->c[2] - of->c[0], w[0] * w[2], sum);
         sum = FMA(of->c[2] - of->c[1], w[1] * w[2], sum);
         sum = FMA(-2 * kappa, v * v, sum);
         d[SITE(row) + i] = FMA(g.h, sum, -g.j[row * g.n + i]);
      }
}

/* What a row receives by itself, and what it hands on to the next one: forces, or products with s by the aim PRODUCT. */
LANE void row_of(const int aim, const int alone, const double *v, const double x, const double y, const double s,
                 const double r, const double *restrict c, double *own, double *handed, const int far,
                 int64_t *beyond) {
   if (aim == PRODUCT)
      (alone ? last_product : row_product)(v, x, y, s, r, c, own, handed, far, beyond);
   else
      (alone ? last_force : row_force)(v, x, y, c, own, handed, far, beyond);
}

/* The end of a row: the force f on x and y is kept in `to`, or kicks p and moves q. */
LANE void settle(const int aim, const double f, const double x, const double more, const double drawn,
                 const kick_of k, const double *restrict c, double *q, double *p, double *to, const int far,
                 int64_t *beyond) {
   if (aim < KICK) {
      *to = f;
      return;
   }
   double push = f;
   if (aim >= KICK_MORE) {
      push = FMA(k.more, more, push);
#if MEAN
      push = FMA(aim == KICK_DRAWN ? k.mean * drawn : k.mean, row_bend(x, c, far, beyond), push);
#endif
   }
   *p -= push;
   *q = FMA(k.reach, *p, x);
}

/* All rows of a strip. s: the vector of products; more: products that a kick adds; drawn: D_kk; to: where forces are
 * kept. */
INLINE sweep(const int aim, const int lanes, const int uses, const record g, const kick_of k, const ptrdiff_t sites,
             const double *restrict c, double *restrict q, double *restrict p, const double *restrict s,
             const double *restrict more, const double *restrict drawn, double *restrict to, const int far) {
   enum { MOST = LANES_OF_STRIP > TILE + 1 ? LANES_OF_STRIP : TILE + 1 };
   double handed[MOST], own[MOST], first[LANES_OF_STRIP], start[LANES_OF_STRIP], v[TERMS], none;
   int64_t beyond = 0;
   const ptrdiff_t end = SITE(sites - 1);
   for (int i = 0; i < lanes; i++) {
      first[i] = RING ? q[i] : 0;
      start[i] = RING && aim == PRODUCT ? s[i] : 0;
      handed[i] = 0;
   }
   if (CLOSED)
#pragma GCC ivdep
      for (int i = 0; i < lanes; i++) {
         weights_of(uses, g, k, sites - 1, sites, i, v);
         row_of(aim, 0, v, RING ? q[end + i] : 0, q[i], RING && aim == PRODUCT ? s[end + i] : 0,
                aim == PRODUCT ? s[i] : 0, c, &none, &handed[i], far, &beyond);
      }
   if (lanes > 1) {
      for (ptrdiff_t row = 0; row < sites - 1; row++) {
         const ptrdiff_t at = SITE(row);
#pragma GCC ivdep
         for (int i = 0; i < lanes; i++) {
            double mine, next;
            weights_of(uses, g, k, row, sites, i, v);
            const double x = q[at + i];
            row_of(aim, 0, v, x, q[at + lanes + i], aim == PRODUCT ? s[at + i] : 0,
                   aim == PRODUCT ? s[at + lanes + i] : 0, c, &mine, &next, far, &beyond);
            settle(aim, handed[i] + mine, x, aim >= KICK_MORE ? more[at + i] : 0,
                   aim == KICK_DRAWN ? drawn[at + i] : 0, k, c, &q[at + i], &p[at + i], &to[at + i], far, &beyond);
            handed[i] = next;
         }
      }
   } else {
      for (ptrdiff_t tile = 0; tile < sites - 1; tile += TILE) {
         const int some = sites - 1 - tile < TILE ? (int)(sites - 1 - tile) : TILE;
#pragma GCC ivdep
         for (int i = 0; i < some; i++) {
            const ptrdiff_t row = tile + i;
            weights_of(uses, g, k, row, sites, 0, v);
            row_of(aim, 0, v, q[row], q[row + 1], aim == PRODUCT ? s[row] : 0, aim == PRODUCT ? s[row + 1] : 0, c,
                   &own[i], &handed[i + 1], far, &beyond);
         }
#pragma GCC ivdep
         for (int i = 0; i < some; i++) {
            const ptrdiff_t row = tile + i;
            settle(aim, handed[i] + own[i], q[row], aim >= KICK_MORE ? more[row] : 0,
                   aim == KICK_DRAWN ? drawn[row] : 0, k, c, &q[row], &p[row], &to[row], far, &beyond);
         }
         handed[0] = handed[some];
      }
   }
#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {
      double mine;
      weights_of(uses, g, k, sites - 1, sites, i, v);
      const double x = q[end + i];
      row_of(aim, !CLOSED, v, x, first[i], aim == PRODUCT ? s[end + i] : 0, start[i], c, &mine, &none, far, &beyond);
      settle(aim, handed[i] + mine, x, aim >= KICK_MORE ? more[end + i] : 0, aim == KICK_DRAWN ? drawn[end + i] : 0, k,
             c, &q[end + i], &p[end + i], &to[end + i], far, &beyond);
   }
   return beyond;
}

/* x + part y in place of x, of all numbers of a strip: drifts of q, and losses of p. */
LANE void add_part(const ptrdiff_t count, const double part, const double *y, double *x) {
#pragma GCC ivdep
   for (ptrdiff_t i = 0; i < count; i++)
      x[i] = FMA(part, y[i], x[i]);
}

/* Steps of a strip in place. */
INLINE strip_of(const int lanes, const int uses, const splitting *of, const int nstep, const ptrdiff_t nham, record g,
                const double *damped, const ptrdiff_t sites, const double *parameters, double *restrict q,
                double *restrict p, const int far) {
   double c[VALUES + 1]; /* a copy that no state may alias */
   memcpy(c, parameters, VALUES * sizeof(double));
   const ptrdiff_t count = SITE(sites);
   double s[count], more[count], drawn[count];
   const double h = g.h, z = damped ? damped[0] : 0, lead = of->c[0];
   const int tableau = of->uses == BY_W;
   kick_of kicks[3], all = {.b = 1, .beta = 1, .eta = of->zeta};
   int64_t beyond = 0;
   for (int i = 0; i < of->kicks; i++) {
      const double leg = (i + 1 < of->kicks ? of->c[i + 1] : 1) - of->c[i];
      kicks[i] = (kick_of){.b = of->b[i], .beta = of->beta[i], .gamma = of->gamma[i], .eta = of->eta[i],
                           .mean = of->samples ? of->share[i] : of->share[i] * of->mean * h * fabs(h),
                           .more = 2 * of->kappa[i] * h, .reach = leg * h};
      if (damped) { /* a tableau of two stages drifts by the mean of momenta before and after the loss */
         kicks[i].loss = expm1(-leg * z);
         if (tableau && of->kicks > 1)
            kicks[i].reach *= FMA(0.5, kicks[i].loss, 1);
         else if (!tableau) {
            kicks[i].reach = z == 0 ? leg * h : h * (-kicks[i].loss / z);
            kicks[i].beta = damped[1 + i];
            kicks[i].gamma = damped[1 + of->kicks + i];
            kicks[i].eta = damped[1 + 2 * of->kicks + i];
         }
      }
   }
   const double early = damped ? expm1(-lead * z) : 0;
   const double reach = damped && !tableau && z != 0 ? h * (-early / z) : lead * h;
   for (int step = 0; step < nstep; step++) {
      if (damped && tableau && lead > 0)
         add_part(count, early, p, p);
      if (lead > 0)
         add_part(count, reach, p, q);
      if (damped && !tableau && lead > 0)
         add_part(count, early, p, p);
      if (MEAN && uses != BY_W && of->samples)
         draw_second(lanes, uses, of, g, kicks, all, sites, drawn);
      for (int i = 0; i < of->kicks; i++) {
         const kick_of k = kicks[i];
         const int products = uses == BY_K && k.more != 0, mean = MEAN && uses != BY_W && k.mean != 0;
         if (products) {
            beyond |= sweep(SLOPE, lanes, uses, g, all, sites, c, q, p, more, more, more, s, far);
            beyond |= sweep(PRODUCT, lanes, uses, g, all, sites, c, q, p, s, s, s, more, far);
         } else if (mean)
            memset(more, 0, (size_t)count * sizeof(double));
         if (mean && of->samples)
            beyond |= sweep(KICK_DRAWN, lanes, uses, g, k, sites, c, q, p, more, more, drawn, s, far);
         else if (products || mean)
            beyond |= sweep(KICK_MORE, lanes, uses, g, k, sites, c, q, p, more, more, more, s, far);
         else
            beyond |= sweep(KICK, lanes, uses, g, k, sites, c, q, p, more, more, more, s, far);
         if (damped)
            add_part(count, k.loss, p, p);
      }
      g.w += nham * g.n;
      g.z += (nham - 1) * g.n;
      g.k += (nham - 1) * g.n;
      g.j += (nham - 1) * g.n;
   }
   return beyond;
}

#define STRIP_OF(name, lanes, uses)                                                                                  \
   static __attribute__((noinline)) int64_t name(const splitting *of, int nstep, ptrdiff_t nham, record g,           \
                                                 const double *damped, ptrdiff_t sites, const double *c, double *q,  \
                                                 double *p, const int far) {                                         \
      return MAY_BE_FAR && far ? strip_of(lanes, uses, of, nstep, nham, g, damped, sites, c, q, p, 1)                \
                               : strip_of(lanes, uses, of, nstep, nham, g, damped, sites, c, q, p, 0);               \
   }
STRIP_OF(strip_by_w, LANES_OF_STRIP, BY_W)
STRIP_OF(strip_by_z, LANES_OF_STRIP, BY_Z)
STRIP_OF(strip_by_k, LANES_OF_STRIP, BY_K)
STRIP_OF(alone_by_w, 1, BY_W)
STRIP_OF(alone_by_z, 1, BY_Z)
STRIP_OF(alone_by_k, 1, BY_K)

/* Lanes first .. of a block through all steps, states stored after every `every` of them; a number below zero if some
 * argument was far. */
static int64_t some_lanes(const splitting *of, const int lanes, const ptrdiff_t first, const int nlane,
                          const ptrdiff_t sites, const ptrdiff_t nham, const int nstep, const int every, const double h,
                          const double *w, const double *const *functionals, const double *q, const double *p,
                          double *qn, double *pn, const double *c, const int far) {
   double x[SITE(sites)], y[SITE(sites)];
   const double *const z = of->uses >= BY_Z ? functionals[0] : w, *const k = of->uses >= BY_K ? functionals[2] : w;
   const double *const j = MEAN && of->samples ? functionals[3] : w;
   int64_t beyond = 0;
   for (ptrdiff_t row = 0; row < sites; row++)
      for (int i = 0; i < lanes; i++) {
         x[row * lanes + i] = q[row * nlane + first + i];
         y[row * lanes + i] = p[row * nlane + first + i];
      }
   for (int out = 0; out < nstep / every; out++) {
      const ptrdiff_t step = (ptrdiff_t)out * every;
      const record g = {w + step * nham * nlane + first, z + step * (nham - 1) * nlane + first,
                       k + step * (nham - 1) * nlane + first, j + step * (nham - 1) * nlane + first, h, 1 / h, nlane};
      const double *const damped = functionals[DAMPED_STEP];
      if (lanes == 1)
         beyond |= (of->uses == BY_W ? alone_by_w : of->uses == BY_Z ? alone_by_z : alone_by_k)(
            of, every, nham, g, damped, sites, c, x, y, far);
      else
         beyond |= (of->uses == BY_W ? strip_by_w : of->uses == BY_Z ? strip_by_z : strip_by_k)(
            of, every, nham, g, damped, sites, c, x, y, far);
      double *const to_q = qn + out * sites * nlane + first, *const to_p = pn + out * sites * nlane + first;
      for (ptrdiff_t row = 0; row < sites; row++)
         for (int i = 0; i < lanes; i++) {
            to_q[row * nlane + i] = x[row * lanes + i];
            to_p[row * nlane + i] = y[row * lanes + i];
         }
   }
   return beyond;
}

/* The contract of symsde_flow in symsde.h. */
static void chain_flow(const splitting *of, const int nlane, const ptrdiff_t sites, const ptrdiff_t nham,
                       const int nstep, const int every, const double h, const double *w, const double *const *functionals,
                       const double *q, const double *p, double *qn, double *pn, const double *c) {
   for (int first = 0; first < nlane;) {
      const int lanes = nlane - first < LANES_OF_STRIP ? 1 : LANES_OF_STRIP;
      for (int far = 0; far < 2; far++)
         if (some_lanes(of, lanes, first, nlane, sites, nham, nstep, every, h, w, functionals, q, p, qn, pn, c, far) >= 0)
            break;
      first += lanes;
   }
}

/* Steps of a scheme by the name, with D_kk of samples or in the mean form. */
#define CHAIN_FLOW(name, scheme, drawn)                                                                              \
   int formula_flow_##name(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h,    \
                           const double *w, const double *const *functionals, const double *q, const double *p,      \
                           double *qn, double *pn, int64_t *status, void *user) {                                    \
      (void)max_iter, (void)t, (void)status;                                                                         \
      splitting of = of_##scheme;                                                                                    \
      of.samples = drawn;                                                                                            \
      chain_flow(&of, nlane, ndof, nham, nstep, every, h, w, functionals, q, p, qn, pn, user);                       \
      return 0;                                                                                                      \
   }
