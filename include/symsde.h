/* SPDX-License-Identifier: BSD-3-Clause
 *
 * symsde: symplectic integration of stochastic Hamiltonian systems
 *
 *    dp = -H_q dt - sum_k H_{k,q} o dW_k      dq = H_p dt + sum_k H_{k,p} o dW_k     (Stratonovich)
 *
 * This header is the whole C interface.
 * - Every function returns a status: 0 ok, < 0 bad input (nothing was computed), > 0 a numerical outcome. The last
 *   argument receives the code and a sentence; it may be NULL.
 * - Handles are opaque and own copies of what they are made from. symsde_<noun>_delete deletes them; it accepts NULL
 *   and sets the handle to NULL. Callback functions and their `user` pointers must live longer than the handle.
 * - Arrays belong to the caller, except those of symsde_state. Shapes are written as in C, last index fastest: the
 *   path (or the lane, the place of a path in a block of paths that are computed together) is always the last index.
 * - Structs begin with struct_size. Fill them with their _init function before you set members.
 * - Several threads may call any function at once, also on handles that they share, but no thread may delete or change
 *   a handle while another one uses it.
 * - A process forked after the library was loaded computes on one thread. dlclose does not unload the library.
 * - Floating-point traps may be on: good input raises none, but failing paths may. All threads round as the calling one.
 * - Quantities are dimensionless unless a comment names a unit.
 */
#ifndef SYMSDE_H
#define SYMSDE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- status ------------------------------------------------------------------------------------ */

enum symsde_status {
   SYMSDE_OK = 0,
   SYMSDE_INVALID_ARGUMENT = -1,
   SYMSDE_INCOMPATIBLE = -2, /* scheme, model and options do not fit together */
   SYMSDE_UNKNOWN_NAME = -3,
   SYMSDE_WRONG_SHAPE = -4,
   SYMSDE_TOO_LARGE = -5,   /* sizes beyond what can be counted, addressed or held */
   SYMSDE_FALSE_TRAIT = -6, /* a declared trait or Hessian is refuted by a probe */
   SYMSDE_NULL_HANDLE = -7,
   SYMSDE_OUT_OF_MEMORY = -8,
   SYMSDE_MISSING_OPERATION = -9, /* the model lacks an operation that the call needs */
   SYMSDE_NOT_CONVERGED = 1,      /* 1 to 5 are also the status of a path */
   SYMSDE_SINGULAR = 2,
   SYMSDE_NONFINITE = 3,
   SYMSDE_CALLBACK_FAILED = 4,
   SYMSDE_STOPPED = 5,
   SYMSDE_PATHS_FAILED = 6, /* the run is complete, some of its paths are not ok */
   SYMSDE_ABSORBED = 7      /* status of a path: it has left the region of an observer, which ends it */
};

#define SYMSDE_MESSAGE_SIZE 1024

typedef struct symsde_error {
   int32_t code;
   char message[SYMSDE_MESSAGE_SIZE]; /* what was given, what is allowed, what to do; ends with 0 */
} symsde_error;

/* Texts are copied into buffer: at most size bytes, terminated. *needed, if not NULL, receives the size of the text. */
int symsde_status_text(int code, char *buffer, size_t size, size_t *needed);
int symsde_version(char *buffer, size_t size, size_t *needed);
/* lines "key: value": version, compiler, compile options, version of the counter map of the noise */
int symsde_build_info(char *buffer, size_t size, size_t *needed);
/* bytes of memory that this process may still take under the limits of its control groups; infinity without a limit */
int symsde_memory_left(double *bytes, symsde_error *error);

/* ---- models ------------------------------------------------------------------------------------ */

typedef struct symsde_model_handle *symsde_model;

typedef struct symsde_traits {
   size_t struct_size;     /* traits: properties that a model declares, which let steps skip work; runs test them */
   int32_t ndof;           /* degrees of freedom */
   int32_t nnoise;         /* noises */
   int32_t separable;      /* every H_j = T_j(p) + U_j(q) */
   int32_t additive;       /* every H_k, k >= 1, is linear */
   int32_t position_noise; /* every H_k, k >= 1, depends on q alone */
   int32_t quadratic;      /* every H_j is a polynomial of degree two at most */
   int32_t identity_mass;  /* H = p.p/2 + U(q) */
   int32_t bandwidth;      /* of every Hessian block; -1 = dense */
   int32_t has_value, has_hessian, has_hessian_vector; /* set by the library */
   double max_frequency;   /* bound of the frequencies of H [1/time]; 0 = not declared */
   double noise_lipschitz; /* Lipschitz constant of the noise [1/sqrt(time)]; 0 = not declared */
   const double *rotation; /* [ndof] frequencies of the stiff linear part; NULL = none */
   const int32_t *silent;  /* [nnoise] not 0: H_k is zero, and nothing is drawn for it; NULL = none */
   int32_t constant_mass;  /* H = p.M^-1 p/2 + U(q) with a constant matrix M */
   int32_t diagonal_mass;  /* M is diagonal; to be declared beside constant_mass */
   /* degrees of freedom, from 1, that noises touch: H_k depends on q_i or p_i. Those of noise k = 1 .. nnoise are
    * touches[touches_from[k-1]] .. touches[touches_from[k] - 1], and touches_from[0] = 0; NULL = not declared */
   const int32_t *touches_from; /* [nnoise + 1] */
   const int32_t *touches;
   int32_t has_gradient, has_parts; /* set by the library */
} symsde_traits;

/* Callbacks compute whole blocks, arrays [..][nlane]; each lane must use its own numbers alone. w[nham][nlane] are the
 * weights of H_0 .. H_m (nham = nnoise + 1). They return 0; another value ends the run (SYMSDE_CALLBACK_FAILED). A lane
 * fails if its result is NaN, as all outputs are before a call. No output is NULL without symsde_model_accept_null. Several
 * threads call at once. */
/* gradient of sum_j w[j] H_j: hq[ndof][nlane], hp[ndof][nlane] */
typedef int (*symsde_gradient)(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                               const double *p, double *hq, double *hp, void *user);
/* value[nlane] of sum_j w[j] H_j */
typedef int (*symsde_value)(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                            double *value, void *user);
/* hqq, hqp, hpp [ndof][ndof][nlane]; hqp[j][i] is the derivative by q_i and p_j */
typedef int (*symsde_hessian)(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                              const double *p, double *hqq, double *hqp, double *hpp, void *user);
/* Hessian times (vq, vp): uq[ndof][nlane], up[ndof][nlane] */
typedef int (*symsde_hessian_vector)(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                     const double *p, const double *vq, const double *vp, double *uq, double *up,
                                     void *user);
/* gradient and Hessian at one point, for models where they share work (sine and cosine of one argument) */
typedef int (*symsde_gradient_hessian)(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                       const double *p, double *hq, double *hp, double *hqq, double *hqp, double *hpp,
                                       void *user);
/* whole steps of one scheme, from q, p [ndof][nlane] to qn, pn [nstep/every][ndof][nlane] after every `every`-th step;
 * nstep is a multiple of `every`. t is the time before the first step, h the step with its sign. w[nstep][nham][nlane]
 * are the weights (h, dW_1 .. dW_m). functionals[0] .. [4] are dZ, areas, K, J and D, [nstep][columns][nlane]; those that
 * the scheme does not use are NULL. If all noises are silent, steps of schemes that use some are the library's.
 * functionals[5] of damped steps are gamma h and, of two or three kicks, their parts of dW, of dZ/h - dW/2 and of K, as
 * many of each; from [10] on exp(-c gamma h) - 1 for c = (3 - sqrt 3)/6, 1/sqrt 3, 1, 1/2 and (3 + sqrt 3)/6,
 * and then exp(-c gamma h).
 * functionals[7] of a model with a quadratic part z.S z/2 are, for each drift between kicks, the rows of exp(tau J S) - 1,
 * z = (q, p), and the rows of S_qq behind all of them.
 * max_iter bounds a solver's iterations in a step. Lanes whose status[nlane] is not 0 have failed: skip them. If a
 * lane fails, set SYMSDE_NOT_CONVERGED or another status of a path, or return values that are not finite and remain
 * so. The bits must not depend on the number of steps in one call. */
typedef int (*symsde_flow)(int nlane, int ndof, int nham, int nstep, int every, int max_iter, double t, double h,
                           const double *w, const double *const *functionals, const double *q, const double *p,
                           double *qn, double *pn, int64_t *status, void *user);
/* the exact flow of a part D of H from the time t to t + tau, tau of either sign: from q, p to qn, pn, [ndof][nlane] each,
 * all of which are written */
typedef int (*symsde_drift)(int nlane, int ndof, double t, double tau, const double *q, const double *p, double *qn,
                            double *pn, void *user);
/* the exact flow of sum_j w[j] K_j over one unit of time, K_0 = H - D and K_k = H_k being those at the time t, all of which
 * commute: w[0] is a part of the step, w[k] of dW_k */
typedef int (*symsde_kick)(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                           double *qn, double *pn, void *user);
/* rows first .. last, counted from 0, of a chain H = p.p/2 + U(q) with noise in position or additive noise, whose
 * Hessian is tridiagonal. q[row][nlane] has rows first - 1 to last + 1 (zero beyond the ends); hq[row][nlane] is the
 * gradient of sum_j w[j] H_j in q; hqq[row][2][nlane] its derivatives by q of this row and by q of the next row */
typedef int (*symsde_chain_rows)(int nlane, int ndof, int nham, int first, int last, double t, const double *w,
                                 const double *q, double *hq, double *hqq, void *user);
/* third derivatives along two vectors: uq, up [ndof][nlane] is the gradient of a^T (the Hessian) b */
typedef int (*symsde_third_derivative)(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                       const double *p, const double *aq, const double *ap, const double *bq,
                                       const double *bp, double *uq, double *up, void *user);
/* products of all noises H_k(t, q) at one pass: g[ndof][nlane], the gradient of sum_k |H_k,q|^2 / 2, which is sum_k (Hess
 * H_k) H_k,q. If s is not NULL there is one degree of freedom, and the same pass gives derivatives of two sums, S = sum_j
 * w[j] H_j and C = sum_j c[j] H_j with c[0] = 0: s[6][nlane] = S', S'', C', C'', C''', g'. Else w and c are NULL */
typedef int (*symsde_squares)(int nlane, int ndof, int nham, double t, const double *q, double *g, const double *w,
                              const double *c, double *s, void *user);
/* covectors over nstep steps of kicks and drifts, backward (symsde_path_gradient): the first nmoving positions move, the
 * others are parameters theta[ndof - nmoving][nlane]. At each state s = nstep .. 0, at the time t + s h and q[s], with
 * a = part[1], or 0 at s = 0, and b = part[0], or 0 at s = nstep: u[ndof][nlane] loses S_qq c, where S = (a + b) h H +
 * sum_k (a dw[s-1][k-1] + b dw[s][k-1]) H_k; then, but at s = 0, c[nmoving][nlane] gains h u of the first nmoving rows.
 * q[nstep + 1][nmoving][nlane], dw[nstep][nham - 1][nlane] */
typedef int (*symsde_pull)(int nlane, int ndof, int nham, int nmoving, int nstep, double t, double h,
                           const double *part, const double *dw, const double *q, const double *theta, double *u,
                           double *c, void *user);
/* f[ndof][nlane]: w[0] F of a force, or sum_k w[k] f_k, k >= 1, of forces on noises */
typedef int (*symsde_force)(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                            double *f, void *user);
/* derivatives of the force, fq and fp [ndof][ndof][nlane]; fq[j][i] is the derivative of component i by q_j */
typedef int (*symsde_force_derivative)(int nlane, int ndof, int nham, double t, const double *w, const double *q,
                                       const double *p, double *fq, double *fp, void *user);
/* rate[nrate][nlane] of damping at (q, t), one rate of all momenta or one for each [1/time] */
typedef int (*symsde_damping)(int nlane, int ndof, int nrate, double t, const double *q, double *rate, void *user);

int symsde_traits_init(symsde_traits *traits);
/* names of the built-in models, one a line */
int symsde_model_names(char *buffer, size_t size, size_t *needed);
/* parameters of a built-in model, lines "key = default" */
int symsde_model_parameters(const char *name, char *buffer, size_t size, size_t *needed, symsde_error *error);
/* a built-in model; parameters that are not given keep their defaults */
int symsde_model_get(const char *name, int nparameter, const char *const *keys, const double *values,
                     symsde_model *model, symsde_error *error);
/* a built-in model with parameters that differ from path to path: values[nparameter][nrow], which are copied. Path
 * first_path + i of a run has row i, or row i/n with row_paths = n of the options, and one row is for all paths, as of
 * symsde_model_set_parameters. They may differ if they are factors of Hamiltonians; alpha of henon_heiles, n and beta of
 * fpu_chain, omega, epsilon, nu and alpha of driven_pendulum are one number for all paths (SYMSDE_INCOMPATIBLE) */
int symsde_model_get_by_path(const char *name, int nparameter, const char *const *keys, int64_t nrow,
                             const double *values, symsde_model *model, symsde_error *error);
/* your own model; value, hessian and hessian_vector may be NULL */
int symsde_model_new(const char *name, const symsde_traits *traits, symsde_gradient gradient, symsde_value value,
                     symsde_hessian hessian, symsde_hessian_vector hessian_vector, void *user, symsde_model *model,
                     symsde_error *error);
/* your own model, H = D + K_0 and H_k = K_k with {K_i, K_j} = 0 for all i, j >= 0, by the exact flows of D and of sum_j
 * w_j K_j alone; value may be NULL. gauss_dkdkd (strong order 3/2) and verlet_dkd_weak2 (weak order 2) step it, whatever
 * D and the K_j are; all other schemes, and results that need derivatives of H, are refused. Of traits give sizes alone */
int symsde_model_new_parts(const char *name, const symsde_traits *traits, symsde_drift drift, symsde_kick kick,
                           symsde_value value, void *user, symsde_model *model, symsde_error *error);
/* Further functions for a model of symsde_model_new, with its user pointer; NULL = none. Runs test them, too. */
/* the same two flows beside a gradient, of which they are tested to be the flows; gauss_dkdkd and verlet_dkd_weak2 take them
 * in the place of all else, also of symsde_model_set_flow. Give both functions, or NULL for both */
int symsde_model_set_parts(symsde_model model, symsde_drift drift, symsde_kick kick, symsde_error *error);
/* called if a scheme needs gradient and Hessian at one point; it also replaces a hessian that is NULL */
int symsde_model_set_gradient_hessian(symsde_model model, symsde_gradient_hessian joint, symsde_error *error);
/* for models with bandwidth 1, identity_mass, and position_noise or additive: midpoint then stores neither the whole
 * force nor the whole matrix. The rows must agree with the gradient to rounding */
int symsde_model_set_chain_rows(symsde_model model, symsde_chain_rows chain_rows, symsde_error *error);
/* makes nested brackets exact; without it schemes approximate them by differences of gradients */
int symsde_model_set_third_derivative(symsde_model model, symsde_third_derivative third, symsde_error *error);
/* for models with position_noise and identity_mass, whose noises meet: the squares of their gradients in kicks and in nested
 * brackets then take one call instead of one or two for each noise, and lose nothing. The products must agree with those of
 * gradients and Hessians to rounding */
int symsde_model_set_squares(symsde_model model, symsde_squares squares, symsde_error *error);
/* for the model of positions and parameters of symsde_path_gradient: steps of kicks around q <- q + h p (stormer_verlet, the
 * Euler pair) are then taken back in one call instead of by a Hessian each. A gradient tests it against products with the
 * Hessian before it is used */
int symsde_model_set_pull(symsde_model model, symsde_pull pull, symsde_error *error);
/* declares that the functions test for NULL: from now on outputs that are not wanted are NULL */
int symsde_model_accept_null(symsde_model model, symsde_error *error);
/* whole steps of a catalogue scheme, without correction; "symplectic_euler, corrected" and
 * "symplectic_euler_adjoint, corrected" are these schemes with the increments form. With ", damped" behind either name they
 * are steps of momenta damped by one rate; without it they also serve between two decays. Runs with that scheme call
 * nothing else. Steps that differ from the library's are refused. midpoint, symplectic_euler and stormer_verlet also
 * stand for equal schemes of other names */
int symsde_model_set_flow(symsde_model model, const char *scheme, symsde_flow flow, symsde_error *error);
/* declares that the bits of a lane do not depend on nlane. From now on the functions get no lanes that only pad a block
 * where these would be half of it or more, and a single path is faster. This holds for loops without contraction (fused
 * multiply-add) that call the C library */
int symsde_model_accept_any_lanes(symsde_model model, symsde_error *error);
/* declares that a program derived the functions from formulas, that they write all outputs, and that neither they nor the
 * data behind user change. The model is then tested before a run only if state or time (flows: or step) enters a new power
 * of two */
int symsde_model_set_derived(symsde_model model, symsde_error *error);
/* damp the momenta of any model: dp_i = .. - gamma_i p_i dt beside the Hamiltonians, with nrate = 1 rate for all degrees
 * of freedom or one for each [1/time]. Rates of zero take it back. A negative rate needs allow_gain. No run may be using
 * the model. Tableaux execute it, and kicks between drifts, rotations or midpoint steps; words take one rate. Schemes of
 * brackets, and of increments for means alone, are refused */
int symsde_model_set_damping(symsde_model model, int nrate, const double *rates, int allow_gain, symsde_error *error);
/* Damp by rates that are a function of position, of time or of both, gamma_i(q, t), with nrate = 1 or one for each degree of
 * freedom, in the place of others; NULL takes them back. A path fails where a rate is negative without allow_gain. No run
 * may be using the model. Tableaux and free drifts with kicks execute it, but words do not; other schemes are refused */
enum symsde_depends { SYMSDE_ON_POSITION = 1, SYMSDE_ON_TIME = 2, SYMSDE_ON_POSITION_AND_TIME = 3 };
int symsde_model_set_damping_function(symsde_model model, symsde_damping rates, int nrate, int depends, int allow_gain,
                                      void *user, symsde_error *error);
/* Friction on velocities, p' = .. - Gamma M^-1 p, by a symmetric matrix [ndof][ndof] [mass/time], where H = p.M^-1 p/2 +
 * U(q) is declared (identity_mass or constant_mass), in the place of rates. Zeros take it back. A negative eigenvalue
 * needs allow_gain. Tableaux execute it, of several stages between two half decays, and drifts with kicks; schemes that
 * add brackets of Hamiltonians and words are refused */
int symsde_model_set_friction(symsde_model model, const double *friction, int allow_gain, symsde_error *error);
/* put a model into a heat bath: dp_i = .. - gamma_i p_i dt, and after the noises of the model one for each degree of freedom,
 * H_k = -sigma_i q_i with sigma_i^2 = 2 gamma_i m_i/beta_i; then exp(-beta H) is stationary, where the model has no other
 * noise. gamma [1/time] and beta = 1/kT [1/energy] are one number each, or one for each degree of freedom. Needs H =
 * sum_i p_i^2/(2 m_i) + U(q), declared as identity_mass or constant_mass, with the same m_i on all
 * paths. Functions and parameters by path of the model are set before */
int symsde_model_thermostat(symsde_model model, int ngamma, const double *gamma, int nbeta, const double *beta,
                            symsde_error *error);
/* let a force F(q,p,t) act on any model, dp = (-H_q + F) dt + .., or forces f_k on its noises, dp = .. + (-H_k,q + f_k) o
 * dW_k. derivative may be NULL (differences then); in_position says that nothing depends on p. user is passed to both.
 * force = NULL takes it back. No run may be using the model. Tableaux execute forces, kicks those in position; other
 * schemes are refused */
int symsde_model_set_force(symsde_model model, symsde_force force, symsde_force_derivative derivative, int in_position,
                           void *user, symsde_error *error);
int symsde_model_set_noise_force(symsde_model model, symsde_force force, symsde_force_derivative derivative,
                                 int in_position, void *user, symsde_error *error);
/* say that no component i of a force depends on q_j or p_j with |i-j| > bandwidth; -1 takes it back. Implicit steps of
 * many degrees of freedom then solve equations with bands, where the Hamiltonians have a bandwidth, too */
int symsde_model_set_force_bandwidth(symsde_model model, int bandwidth, symsde_error *error);
/* Functions of a model with parameters by path get a pointer to this struct in place of their user pointer. */
typedef struct symsde_lanes {
   const double *parameters; /* [nparameter][nlane] of the lanes of this call */
   void *user;               /* the user pointer of symsde_model_new */
} symsde_lanes;
/* Parameters that differ from path to path, for a model of symsde_model_new: values[nparameter][nrow], which are
 * copied. Path first_path + i of a run has row i, so nrow must be its number of paths; one row is for all paths. With
 * row_paths = n of the options it has row i/n, and nrow is the number of paths divided by n.
 * nparameter = 0 removes them. Calls without paths (probes, diagnoses) have row 0; evaluations at npath = nrow
 * points have row i at point i. No run may be using the model */
int symsde_model_set_parameters(symsde_model model, int nparameter, int64_t nrow, const double *values,
                                symsde_error *error);
/* Declare a quadratic part D of H for a model of symsde_model_new, H = D(q,p) + V(q) with D = z.S z/2, z = (q, p) and S =
 * second[2*ndof][2*ndof]: any coupling of q and p, as in magnetic fields and rotating frames. gauss_dkdkd, verlet_kdk,
 * chin4a and their _strong2 then kick by V and by noises in position, between exact flows of D. H_p = S_pq q + S_pp p is
 * tested; S_qq is a choice, since V is the remainder. NULL takes it back. No run may be using the model */
int symsde_model_set_quadratic_part(symsde_model model, const double *second, symsde_error *error);
/* Declare, after a quadratic part D, that H - D and every H_k are functions of the actions (q_i^2 + p_i^2)/2: lattices of
 * nonlinear Schroedinger equations with noise of phases. Kicks then turn planes (q_i, p_i), as gauss_dkdkd does; schemes
 * whose brackets ask for functions of q are refused. on = 2 says that every H_k is linear in the actions, too: then
 * verlet_kdk and the _strong2 of both add their brackets to the bonds of D. Tested; on = 0 takes it back. No run may be
 * using the model */
int symsde_model_set_action_kicks(symsde_model model, int on, symsde_error *error);
/* Tell the wide model of symsde_path_gradient, of ndof positions and the parameters behind them, how the linear flows
 * between kicks of the model without parameters change: second[parameter][2*ndof][2*ndof], derivatives of S of its
 * quadratic part, and squares[parameter][ndof], of the squares of its frequencies; NULL where it has none. Gradients
 * compare S_pq and S_pp with the Hessian of the wide model; S_qq and frequencies are a choice, and their slopes say how
 * it changes. No run may be using the model */
int symsde_model_set_flow_slopes(symsde_model wide, int ndof, const double *second, const double *squares,
                                 symsde_error *error);
/* another model with the same functions, for another user pointer, and with other frequencies rotation[ndof] of the
 * stiff linear part (NULL: those of model). The functions must read the memory behind user as data alone, since
 * tests that one of the models has passed are not repeated for the other */
int symsde_model_with_user(symsde_model model, void *user, const double *rotation, symsde_model *made,
                           symsde_error *error);
int symsde_model_delete(symsde_model *model);
/* the traits of a model; rotation, silent and touches point into the model and are valid as long as it exists */
int symsde_model_traits(symsde_model model, symsde_traits *traits, symsde_error *error);
/* check declared traits and Hessians at three points around q0[ndof], p0[ndof] */
int symsde_model_probe(symsde_model model, double t, const double *q0, const double *p0, symsde_error *error);
/* Declare of a model all traits that its gradient does not refute at three points around q0[ndof], p0[ndof]: separable,
 * quadratic, the mass, additive and position_noise, and bands of up to 3. A probe refutes a trait and proves none. Runs
 * probe again around their initial state. No run may be using the model */
int symsde_model_set_probed_traits(symsde_model model, double t, const double *q0, const double *p0,
                                   symsde_error *error);
/* evaluate at npath points; shapes as in the callbacks, with npath for nlane */
int symsde_model_value(symsde_model model, int64_t npath, double t, const double *w, const double *q, const double *p,
                       double *value, symsde_error *error);
int symsde_model_gradient(symsde_model model, int64_t npath, double t, const double *w, const double *q,
                          const double *p, double *hq, double *hp, symsde_error *error);
int symsde_model_hessian(symsde_model model, int64_t npath, double t, const double *w, const double *q, const double *p,
                         double *hqq, double *hqp, double *hpp, symsde_error *error);

/* sine[n] and cosine[n] of x[n] radians, for callbacks. This is several times as fast as the C library lane by lane. For
 * |x| <= 1e5 they are within 1 ulp, with the same bits on every processor with fused multiply-add; for larger |x| they
 * are those of the C library. A lane depends on its own x alone. The arrays must not
 * overlap. The status is SYMSDE_INVALID_ARGUMENT if an array is NULL or n < 0; a callback has no use for a message */
int symsde_sincos(int n, const double *x, double *sine, double *cosine);

/* ---- schemes ----------------------------------------------------------------------------------- */

typedef struct symsde_scheme_handle *symsde_scheme;

/* the evidence for an order or for the structure of a scheme: derived from conditions on its coefficients, or claimed by
 * its authors; measured orders are given in addition */
enum symsde_evidence { SYMSDE_EVIDENCE_NONE = 0, SYMSDE_EVIDENCE_CLAIMED = 1, SYMSDE_EVIDENCE_DERIVED = 2 };

/* The five orders of a scheme: [0] strong order for additive noise, [1] for commutative noise, [2] for general
 * noise, [3] for noises whose flows commute with each other and with the flow of the drift; [4] weak order for
 * commutative noise */
#define SYMSDE_ORDERS 5

typedef struct symsde_scheme_info {
   size_t struct_size;
   int32_t form;   /* 1 tableau, 2 Galerkin, 3 Euler-Maruyama, 4 drifts and kicks */
   int32_t nstage; /* stages, quadrature nodes */
   int32_t degree; /* degree of the polynomial; 0 = not made from one */
   int32_t symplectic, symmetric;
   int32_t keeps_quadratic, keeps_bilinear; /* keeps exactly: quadratic invariants; invariants q^T D p */
   int32_t structure_evidence; /* for these four: derived from the coefficients, or claimed (special schemes) */
   double symplecticity_residual, symmetry_residual, quadratic_residual; /* of the coefficients; 0 = holds */
   double stratonovich_sum;       /* beta^T b e; 1/2 = consistent with the Stratonovich equation */
   double correction_coefficient; /* 1/2 - beta^T b e, which is 1/2 - lambda; 0 = needs no correction */
   int32_t correction_needed, correction_exists;
   double order[SYMSDE_ORDERS]; /* corrected where needed; 0 = none */
   int32_t order_evidence[SYMSDE_ORDERS]; /* enum symsde_evidence */
   int32_t order_noise_free;
   double measured_order[SYMSDE_ORDERS], measured_half_width[SYMSDE_ORDERS]; /* 95 %; NaN = not measured */
   double measured_floor[SYMSDE_ORDERS]; /* error of the reference over the smallest error that counts */
   int32_t uses_dz, uses_areas, uses_stt_area, uses_magnus; /* functionals of the path beside dW: dZ, A, K, J */
   int32_t uses_nested_bracket; /* 0 none, 1 {{H,H_k},H_k}, 2 {{H_l,H_k},H_k} of noises, too */
   int32_t law;          /* of the increments: 0 Gaussian, 1 three-point, 2 two-point */
   int32_t explicit_for; /* 0 no model, 1 separable models, 2 every model */
   int32_t gradients_per_step, unknowns, unknowns_if_separable; /* for each iteration; for each degree of freedom */
   char name[64];
   char reference[256];
} symsde_scheme_info;

int symsde_scheme_info_init(symsde_scheme_info *info);
/* names of the catalogue, one a line */
int symsde_scheme_names(char *buffer, size_t size, size_t *needed);
int symsde_scheme_get(const char *name, symsde_scheme *scheme, symsde_error *error);
/* the scheme of a quadrature of the action: nodes and weights [nnode], polynomials of this degree; noise_weights
 * [nnode] are the weights of the noise, NULL = those of the drift */
int symsde_scheme_from_quadrature(int nnode, const double *nodes, const double *weights, const double *noise_weights,
                                  int degree, const char *name, symsde_scheme *scheme, symsde_error *error);
/* your own tableau: a, abar [nstage][nstage] (row i = stage i), alpha[nstage] for the drift; b, bbar, beta
 * for the noise, each NULL = as for the drift */
int symsde_scheme_from_tableau(int nstage, const double *a, const double *abar, const double *alpha, const double *b,
                               const double *bbar, const double *beta, const char *name, int allow_nonsymplectic,
                               symsde_scheme *scheme, symsde_error *error);
/* coefficients of a scheme: nodes c, and the arguments of symsde_scheme_from_tableau; NULL = not wanted. Brackets
 * and maps around the tableau are not part of it. SYMSDE_MISSING_OPERATION if the scheme has no tableau */
int symsde_scheme_tableau(symsde_scheme scheme, double *c, double *a, double *abar, double *alpha, double *b,
                          double *bbar, double *beta, symsde_error *error);
/* The adjoint is the inverse of a step back in time. The symmetric composition is half a step of base, then half a
 * step of its adjoint. The triple jump is three steps of a symmetric base, the second one backwards; it raises the
 * order without noise by two. name = NULL: the name of base with a suffix */
int symsde_scheme_adjoint(symsde_scheme base, const char *name, symsde_scheme *scheme, symsde_error *error);
int symsde_scheme_symmetric_composition(symsde_scheme base, const char *name, symsde_scheme *scheme,
                                        symsde_error *error);
int symsde_scheme_triple_jump(symsde_scheme base, const char *name, symsde_scheme *scheme, symsde_error *error);
/* one step made of steps of parts[npart] in this order, with fractions[npart] of h and of all increments */
int symsde_scheme_compose(int npart, const symsde_scheme *parts, const double *fractions, const char *name,
                          symsde_scheme *scheme, symsde_error *error);
int symsde_scheme_delete(symsde_scheme *scheme);
int symsde_scheme_get_info(symsde_scheme scheme, symsde_scheme_info *info, symsde_error *error);
/* what is proved, claimed and measured about the scheme, as readable lines */
int symsde_scheme_certificate(symsde_scheme scheme, char *buffer, size_t size, size_t *needed, symsde_error *error);

/* ---- runs -------------------------------------------------------------------------------------- */

enum symsde_correction {
   SYMSDE_CORRECTION_AUTO = 0, /* the increments form, or none if the traits prove that it vanishes */
   SYMSDE_CORRECTION_NONE = 1,
   SYMSDE_CORRECTION_MEAN = 2,
   SYMSDE_CORRECTION_INCREMENTS = 3
};

/* How Levy areas are drawn, by schemes that use them. */
enum symsde_areas {
   SYMSDE_AREAS_PATH = 0, /* areas of the path, with a mean-square error below |h|^3/area_time */
   SYMSDE_AREAS_LAW = 1   /* areas in law given dW and dZ, at bounded cost, not of the path: refine < 0 is refused */
};

/* The noise of linear damped drifts, in schemes of kicks such as gauss_dkdkd: of free motion with one rate, else of
 * noises that are constant. */
enum symsde_damping_noise {
   SYMSDE_DAMPING_NOISE_LAW = 0,        /* LAW2, or LAW3 if the scheme draws K, as chin4a does */
   SYMSDE_DAMPING_NOISE_LAW2 = 1,       /* exact law, from dW and dZ */
   SYMSDE_DAMPING_NOISE_LAW3 = 2,       /* exact law, from dW, dZ and K */
   SYMSDE_DAMPING_NOISE_PATH = 3,       /* of the path itself, one rate: steps and their halves agree; draws K, E */
   SYMSDE_DAMPING_NOISE_POLYNOMIAL = 4  /* weights as without damping: orders hold, the law of free motion does not */
};

/* Called on the calling thread, at most twenty times a second, with the work done and the total: path-steps of a run,
 * parts of a diagnosis. Nonzero stops the work. A stopped run returns what it has reached, a diagnosis nothing. */
typedef int (*symsde_progress)(int64_t done, int64_t total, void *user);
/* Called before the first step, once, on the calling thread, if there is something to warn of (symsde_report.warnings).
 * Nonzero refuses the run, with SYMSDE_CALLBACK_FAILED. */
typedef int (*symsde_warn)(const char *warnings, void *user);

typedef struct symsde_options {
   size_t struct_size;
   double step;            /* h, may be negative, never zero [time] */
   int64_t steps;          /* a multiple of save_every */
   int64_t paths;
   uint64_t seed;
   double t0;              /* time of step 0 [time] */
   int64_t save_every;     /* steps between saved points */
   int64_t first_path;     /* global index of the first path */
   int64_t first_step;     /* index of the first step, which chooses its noise: 0 draws the noise of step 0 again */
   int32_t refine;         /* l > 0: a step sums 2^l draws; l < 0: halved by the Brownian bridge -l times */
   int32_t correction;     /* enum symsde_correction */
   double truncation;      /* order l of truncated increments; 0 = none */
   double truncation_time; /* time scale of the truncation [time] */
   int32_t compensated;    /* compensated summation of the state */
   int32_t general;        /* use the general stepper */
   int32_t max_iter;       /* Newton iterations in a step */
   int32_t fixed_point;    /* n > 0: n fixed-point iterations instead of Newton */
   int32_t lanes;          /* lanes of a block, a multiple of 8; 0 = automatic; never changes a result */
   int32_t threads;        /* 0 = SYMSDE_NUM_THREADS, else OpenMP's default; always one in a forked process */
   symsde_progress progress; /* for diagnoses; runs use progress of their input. May be NULL */
   void *progress_user;
   double area_time;       /* time scale of areas by the path; 0 = derived from the model [time] */
   int32_t areas;          /* enum symsde_areas */
   uint64_t common_noise;  /* bit k - 1: every path gets the W_k of path 0; other noises differ by path */
   int64_t noise_paths;    /* n > 0: path first_path + i has the noise of path first_path + i % n; 0 = its own */
   int32_t damping_noise;  /* enum symsde_damping_noise */
   int64_t row_paths;      /* n: path first_path + i has row i/n of parameters that differ by path (default 1) */
} symsde_options;
int symsde_options_init(symsde_options *options);
/* checks options as every function does that takes options, and refuses them with the same sentences */
int symsde_options_check(const symsde_options *options, symsde_error *error);

/* The input of a run besides model, scheme and options. */
typedef struct symsde_input {
   size_t struct_size;
   const double *q0, *p0;         /* [ndof][q0_paths], [ndof][p0_paths] */
   int64_t q0_paths, p0_paths;    /* 1 (the same for all) or the number of paths */
   const double *increments;      /* [steps*2^refine][nnoise of dW, dZ, K][increment_paths], or NULL */
   int64_t increment_rows, increment_noises, increment_paths; /* paths: 1 (the same for all) or all */
   const double *q0_low, *p0_low; /* low parts [ndof][paths], to resume a compensated run; NULL = zero */
   symsde_progress progress;      /* may be NULL */
   void *progress_user;
   symsde_warn warn; /* may be NULL; symsde_run_new calls it, too */
   void *warn_user;
   /* numbers from one row, noise and path to the next, [3], 0 or more: increments in another order of memory, or part of
    * a larger array; NULL = those of the array above. Runs read each number once, a block of paths at a time */
   const int64_t *increment_strides;
} symsde_input;
int symsde_input_init(symsde_input *input);
typedef struct symsde_report {
   size_t struct_size;
   int32_t status;      /* the outcome of the whole run, also returned */
   int32_t correction;  /* the correction that was used */
   /* path_steps: steps until paths failed, were absorbed or stopped; normals: numbers drawn for these steps */
   int64_t path_steps, normals, gradients, hessians, hessian_vectors, iterations, solves, lapack_solves;
   int64_t failures, damped, continued; /* steps not solved from zero; by shortened corrections; by continuation */
   int64_t failed, stopped; /* paths */
   int32_t threads, lanes; /* lanes of a block: 1 if few paths run one by one */
   double lost_variance, seconds_setup, seconds_run; /* lost_variance: lost by truncation from a normal number */
   char stepper[64], left_out[512], warnings[2048]; /* warnings: problems found before the run, one a line */
   char functionals[32]; /* used beside dW, as "dZ and K"; for refine < 0 the path depends on them */
   int64_t pivoted_solves; /* solves with exchanges of rows */
   char lapack[128];       /* the LAPACK that has solved systems; "" if lapack_solves is 0 */
   int64_t grown;        /* paths that are ok, but both |q| and |p| grew 1e6-fold after a tenth of the run */
   char damping[192];    /* what damps the momenta, and what that is for velocities; "" of a closed system */
} symsde_report;
int symsde_report_init(symsde_report *report);
/* Saved paths, in the caller's arrays; ntime = steps/save_every + 1. Values after a failure are NaN. */
typedef struct symsde_paths {
   size_t struct_size;
   double *t;                  /* [ntime]; NULL = not wanted */
   double *q, *p;              /* [ntime][ndof][paths] */
   int32_t *status;            /* [paths]: 0 or a status above 0 */
   int64_t *failed_step;       /* [paths]: absolute step that failed, -1 = none */
   double *last_q, *last_p;    /* [ndof][paths], last good state; NULL = not wanted */
   double *q_low, *p_low;      /* [ndof][paths], low parts of this state if compensated; NULL = not wanted */
} symsde_paths;
int symsde_paths_init(symsde_paths *paths);
int symsde_simulate(symsde_model model, symsde_scheme scheme, const symsde_options *options, const symsde_input *input,
                    symsde_paths *paths, symsde_report *report, symsde_error *error);

/* values[nvalue][nlane] of your own observables; observables that mix lanes are refused; nonzero ends the run */
typedef int (*symsde_observables)(int nlane, int ndof, double t, const double *q, const double *p, double *values,
                                  void *user);

/* Streaming observers: statistics of a run of moments; neither paths nor steps add to their memory (docs/observers.md) */
enum symsde_observer_kind {
   SYMSDE_OBSERVE_HISTOGRAM = 1,       /* a value in `bins` bins of equal width from low to high */
   SYMSDE_OBSERVE_QUANTILES = 2,       /* magnitudes from low to high in bins of equal relative width, both signs */
   SYMSDE_OBSERVE_COVARIANCE = 3,      /* of nvalue values */
   SYMSDE_OBSERVE_AUTOCORRELATION = 4, /* of a value along time, lags 0 .. `bins` saved points; low: near the mean */
   SYMSDE_OBSERVE_EXTREMES = 5,        /* lowest and highest value of each path until each saved time */
   SYMSDE_OBSERVE_PASSAGE = 6,         /* paths whose value leaves low < x < high; checked after every step */
   SYMSDE_OBSERVE_PATHS = 7,           /* nvalue values of the paths with the indices `paths`, ascending */
   SYMSDE_OBSERVE_MEANS = 8            /* means of nvalue values */
};
typedef struct symsde_observer {
   size_t struct_size;
   int32_t kind, nvalue;
   const int32_t *values; /* [nvalue] numbers of values, in the order of symsde_moments, from 0 */
   double low, high;
   int32_t bins, nshare; /* nshare: the number of quantiles that a histogram returns instead of shares */
   const double *shares; /* [nshare], 0 .. 1 */
   int64_t npath;
   const int64_t *paths; /* [npath] global indices */
   int32_t absorbs, bridges; /* passage: whether paths end there; whether they may leave between steps (default 1) */
   int64_t *counts;          /* output, like sums; parts merge by both; NULL = not wanted */
   double *sums;
   int64_t ngroup; /* groups of paths, each with a statistic of its own; 0: all paths are one group */
   const int32_t *labels; /* [paths of the run] group of each path, from 0; paths with others are in no group. counts,
                             sums and answers are those of group 0, then of group 1, .. */
} symsde_observer;
int symsde_observer_init(symsde_observer *observer);
/* sizes[3]: of counts, of sums and of an answer, in a run with these options and nobservable observables */
int symsde_observer_sizes(symsde_model model, const symsde_options *options, int nobservable,
                          const symsde_observer *observer, int64_t *sizes, symsde_error *error);
/* merges two sibling parts as symsde_merge_moments does: left becomes the merged part */
int symsde_observer_merge(symsde_model model, const symsde_options *options, int nobservable, symsde_observer *left,
                          const symsde_observer *right, symsde_error *error);
/* the results and their standard errors from counts and sums, both [sizes[2]]; NaN if nothing is known */
int symsde_observer_answer(symsde_model model, const symsde_options *options, int nobservable,
                           const symsde_observer *observer, double *values, double *errors, symsde_error *error);

#define SYMSDE_MAX_FAILED_LISTED 1000

/* Moments over the paths that are ok up to each time. Values: q_1 .. q_n, p_1 .. p_n, the energy where the
 * model has has_value, then the user's observables: nvalue = 2*ndof + has_value + nobservable. */
typedef struct symsde_moments {
   size_t struct_size;
   double *t;           /* [ntime] */
   int64_t *n_ok;       /* [ntime] */
   double *mean, *variance, *se_mean; /* [ntime][nvalue] */
   int32_t nobservable; /* input: values of the observables callback; 0 = none */
   symsde_observables observables;
   void *observables_user;
   int64_t nfailed_listed; /* output: how many of the following are filled */
   int64_t failed[SYMSDE_MAX_FAILED_LISTED];      /* global indices, ascending */
   int32_t failed_status[SYMSDE_MAX_FAILED_LISTED];
   int64_t failed_step[SYMSDE_MAX_FAILED_LISTED];
   double *m2; /* [ntime][nvalue]: sums of squared deviations, by which parts merge; may be NULL */
   int32_t observables_lanes; /* input: n > 0 if the observables do not depend on t: one call may get the paths of
                                 several saved times, up to n lanes (one time at least), with t of the first time */
   int32_t nobserver; /* number of streaming observers */
   symsde_observer *const *observers; /* [nobserver] */
   symsde_paths *paths; /* saved paths, or with q, p NULL their status and last states alone; NULL = not wanted */
} symsde_moments;
int symsde_moments_init(symsde_moments *moments);
int symsde_compute_moments(symsde_model model, symsde_scheme scheme, const symsde_options *options,
                           const symsde_input *input, symsde_moments *moments, symsde_report *report,
                           symsde_error *error);

/* A function f of the paths first .. first + lanes - 1: value[lanes], and its derivatives by the states at the saved
 * times, fq = df/dq and fp = df/dp, [ntime][ndof][lanes], and by parameters where f holds them itself,
 * fparameter[nparameter][lanes]. Derivatives are zero before the call. Returns 0, or a code that ends the run. */
typedef int (*symsde_path_function)(int64_t first, int lanes, int ndof, int ntime, int nparameter, const double *t,
                                    const double *q, const double *p, double *value, double *fq, double *fp,
                                    double *fparameter, void *user);
/* f of each path and its derivatives by the exact discrete adjoint of every step: value[paths], by_q0 and then by
 * parameters in by_q[ndof + nparameter][paths], by p0 in by_p[ndof][paths], codes[paths], failed_step[paths]; NaN where
 * a path failed. Their means are the gradient of E f. `wide` has the positions q_1 .. q_n and the parameters, as many
 * momenta, and the Hamiltonians of `model`, which do not depend on momenta of parameters; without parameters it is the
 * model itself. parameters[nparameter][nrow]: their values, nrow = paths or 1. Behind them, ndof more stand for the rates
 * of damping, for derivatives by these; their values are not read. f is called for the paths of a block by any
 * thread, or for all paths in runs too long to be kept. Models and schemes without exact derivatives are refused. */
int symsde_path_gradient(symsde_model model, symsde_model wide, symsde_scheme scheme, const symsde_options *options,
                         const symsde_input *input, int nparameter, int64_t nrow, const double *parameters,
                         symsde_path_function f, void *user, double *value, double *by_q, double *by_p, int32_t *codes,
                         int64_t *failed_step, symsde_report *report, symsde_error *error);

/* Tangent vectors of each path, v[nvector][2 ndof][paths], dq and then dp: in at the beginning, out at the end. The last
 * nparameter vectors are derivatives by the parameters of `wide`, and begin at zero. With turn > 0 (without parameters)
 * vectors are made orthonormal every `turn` steps and at the end, v = Q R, and logs[nvector][paths] has the sums of
 * log R_ii: divided by the time these are Lyapunov exponents. last_q, last_p[ndof][paths]: the state at the end. */
int symsde_path_tangent(symsde_model model, symsde_model wide, symsde_scheme scheme, const symsde_options *options,
                        const symsde_input *input, int nparameter, int64_t nrow, const double *parameters, int nvector,
                        int64_t turn, double *v, double *logs, double *last_q, double *last_p, int32_t *codes,
                        int64_t *failed_step, symsde_report *report, symsde_error *error);

/* Parts of an ensemble merge to the bits of the whole. A part consists of the paths j 2^k .. (j+1) 2^k - 1, k >= 8, by
 * global index (the last part may end earlier). Two siblings, j even on the left and j + 1 on the right, merge into part
 * j/2 of 2^(k+1) paths: n_ok[ntime], mean and m2[ntime][nvalue] of the left part become those of both. */
int symsde_merge_moments(int64_t ntime, int64_t nvalue, int64_t *n_ok, double *mean, double *m2,
                         const int64_t *n_ok_right, const double *mean_right, const double *m2_right,
                         symsde_error *error);
/* variance and se_mean[ntime][nvalue] of merged parts, as symsde_compute_moments gives them: NaN for fewer than two
 * paths; the mean of no path becomes NaN, too */
int symsde_moment_errors(int64_t ntime, int64_t nvalue, const int64_t *n_ok, double *mean, const double *m2,
                         double *variance, double *se_mean, symsde_error *error);

/* A prepared run checks, probes and allocates once. Then it takes steps in as many calls as you want. Steps in several
 * calls give the same bits as in one. The handle owns copies of model and scheme, so these may be deleted. A run serves
 * one call at a time and refuses a second one, from another thread or from a callback (SYMSDE_INCOMPATIBLE). Delete it
 * when no call is in progress. */
typedef struct symsde_run_handle *symsde_run;

/* The state of a prepared run: arrays of the library, which do not move until the run is deleted. Between calls you may
 * read them, and change q, p and their low parts. */
typedef struct symsde_state {
   size_t struct_size;
   double *q, *p;              /* [ndof][paths] */
   double *q_low, *p_low;      /* [ndof][paths]; NULL unless compensated */
   const int32_t *status;      /* [paths]: 0 or a status above 0, which a path keeps until the run is reset */
   const int64_t *failed_step; /* [paths]: absolute step that failed, or the next step of a stopped path; -1 = none */
   int64_t paths;
   int32_t ndof, nnoise;
   int64_t next_step; /* absolute index of the next step; after a stop, of the next step after resuming */
   double t; /* time before that step [time] */
} symsde_state;
int symsde_state_init(symsde_state *state);
/* prepare a run; steps and save_every of the options and increments and progress of the input are ignored */
int symsde_run_new(symsde_model model, symsde_scheme scheme, const symsde_options *options, const symsde_input *input,
                   symsde_run *run, symsde_error *error);
/* takes further steps. input = NULL: with the run's own noise; else with the increments [steps*2^refine] and the progress
 * of input, whose state is ignored. paths = NULL: nothing is saved; else t, q and p of the first state and after every
 * save_every steps. Returns SYMSDE_PATHS_FAILED if some paths are not ok, even if they failed in an earlier call */
int symsde_run_advance(symsde_run run, int64_t steps, int64_t save_every, const symsde_input *input,
                       symsde_paths *paths, symsde_error *error);
/* complete a stopped advance, with its increments and arrays; before this, or a reset, the run does not advance again */
int symsde_run_resume(symsde_run run, const symsde_input *input, symsde_paths *paths, symsde_error *error);
/* start again from the state of an input; all paths are ok */
int symsde_run_reset(symsde_run run, const symsde_input *input, uint64_t seed, int64_t first_path, int64_t first_step,
                     symsde_error *error);
int symsde_run_state(symsde_run run, symsde_state *state, symsde_error *error);
/* counters and seconds of all calls, and the outcome of the last one; warnings assume a million steps */
int symsde_run_report(symsde_run run, symsde_report *report, symsde_error *error);
int symsde_run_delete(symsde_run *run);
/* Initial states drawn from a law: q, p[ndof][paths] of the paths first_path .. first_path + paths - 1 are the rows of
 * centre[2*ndof] + factor[2*ndof][2*ndof] z, those of q before those of p; z are standard normal numbers, or uniform
 * ones between -1 and 1. With columns = 1 coordinates are independent, and factor[2*ndof] their deviations. A path's z
 * depend on seed, stream (0 .. 63; 0 for states), path and degree of freedom alone, and on no noise of a run. */
enum symsde_law { SYMSDE_NORMAL_STATES = 1, SYMSDE_UNIFORM_STATES = 2 };
int symsde_draw_states(int law, uint64_t seed, int stream, int64_t first_path, int64_t paths, int ndof, int columns,
                       const double *centre, const double *factor, double *q, double *p, symsde_error *error);
/* t[ntime] of the saved points of a run with these options, as symsde_simulate saves them */
int symsde_saved_times(const symsde_options *options, double *t, symsde_error *error);
/* the increments that drive a run of this scheme with these options: dw[steps][nnoise][paths]; scheme = NULL: for any
 * scheme that takes Gaussian increments alone */
int symsde_increments(symsde_model model, symsde_scheme scheme, const symsde_options *options, double *dw,
                      symsde_error *error);

/* ---- diagnostics ------------------------------------------------------------------------------- */

/* defect[npoint]: max |M^T J M - J| of the tangent map M of one step from (q, p)[ndof][npoint] with frozen
 * increments dw[nnoise][npoint] */
int symsde_symplecticity(symsde_model model, symsde_scheme scheme, const symsde_options *options, int64_t npoint,
                         const double *q, const double *p, const double *dw, double *defect, symsde_error *error);
/* discrete action of each step, [WHSB] (49): action[steps][paths], for q, p [steps+1][ndof][paths] from a run
 * with save_every = 1 and its increments dw[steps][nnoise][paths] */
int symsde_discrete_action(symsde_model model, symsde_scheme scheme, const symsde_options *options, const double *q,
                           const double *p, const double *dw, double *action, symsde_error *error);
/* largest residuals over steps and degrees of freedom, residual[4][paths]: discrete Euler-Lagrange equations in q,
 * [WHSB] (47), and p, (48); Legendre transforms at the left end, (53)-(54), and the right end of a step, (57)-(58) */
int symsde_euler_lagrange_residual(symsde_model model, symsde_scheme scheme, const symsde_options *options,
                                   const double *q, const double *p, const double *dw, double *residual,
                                   symsde_error *error);
/* the path from q_start to q_end [ndof][paths] that makes the discrete action stationary, [WHSB] (46)-(48), with the
 * increments of a run with these options, or dw[steps*2^refine][nnoise][paths]: q, p [steps+1][ndof][paths] and
 * path_status[paths], SYMSDE_SINGULAR if the end points are conjugate. Paths that are not ok are NaN. dw and the first
 * guesses [steps+1][ndof][paths] may be NULL. Returns SYMSDE_PATHS_FAILED if some paths are not ok */
int symsde_stationary_path(symsde_model model, symsde_scheme scheme, const symsde_options *options,
                           const double *q_start, const double *q_end, const double *dw, const double *guess_q,
                           const double *guess_p, double *q, double *p, int32_t *path_status, symsde_error *error);
/* whether the noises commute, from brackets at points q, p [ndof][npoint]. gradients[2]: the largest relative gradients
 * of {H_k,H_l} and of {H,H_k}; commute[2]: whether the noises commute there, and whether the noises commute with the
 * drift; text (size bytes, may be NULL): which strong order to expect from which scheme. progress (may be NULL) is
 * called before each of the nnoise (nnoise + 1)/2 brackets; SYMSDE_STOPPED if it returns nonzero */
int symsde_commutator(symsde_model model, double t, int64_t npoint, const double *q, const double *p, double *gradients,
                      int32_t *commute, char *text, size_t size, symsde_progress progress, void *user,
                      symsde_error *error);
/* exact solution q, p [ntime][ndof][paths] on the run's own Brownian path, if the model has one: quadratic models with
 * flows that commute, or with constant noise, by dW, dZ, K of the run and two more draws a step and degree of freedom;
 * damped by numbers or a matrix, too. SYMSDE_INCOMPATIBLE for schemes with two- or three-point increments, and for
 * SYMSDE_DAMPING_NOISE_PATH */
int symsde_exact_solution(symsde_model model, symsde_scheme scheme, const symsde_options *options,
                          const symsde_input *input, double *q, double *p, symsde_error *error);

#ifdef __cplusplus
}
#endif

#endif
