/* SPDX-License-Identifier: BSD-3-Clause
 * Elementary functions of one lane, inlined into generated loops over lanes, which a compiler turns into vectors.
 *
 * Each works by bits and polynomials, without branches, where its argument is ordinary; elsewhere it makes *beyond
 * negative, and the loop is run again with far = 1, where such lanes take the function of the C library. A lane depends
 * on its own argument alone. Compilers contract nothing by themselves, so that bits are the same for every width of
 * vectors: FMA(a, b, c) is one operation where the library contracts, too, and the processor can, and else two.
 *
 *    function  ordinary arguments              largest error there, ulp (tests/python/test_formulas_functions.py)
 *    sincos    |x| <= 1e5                      1
 *    exp       |x| <= 708                      1
 *    log       positive, normal                1
 *    tanh      finite                          2
 *    sinh      |x| <= 708                      2
 *    cosh      |x| <= 708                      2
 *    atan      finite                          1
 *    asin      |x| <= 1                        1.5
 *    acos      |x| <= 1                        1.5
 *    asinh     |x| <= 1e150                    2
 *    acosh     1 <= x <= 1e150                 2
 *    atanh     |x| < 1                         2
 *    sech      |x| <= 708, |x| > 746           2
 *    csch      |x| <= 708, |x| > 746           2.5
 *    coth      finite                          2.5
 *    erf       finite                          2
 *    erfc      |x| <= 26, |x| > 27.4          3
 *    gauss     |x| <= 26.6, |x| > 27.3         1     exp(-x^2)
 *    log1p     x > -1, finite                  1     log(1 + x)
 *    logcosh   finite                          3     log(cosh(x))
 *    pow       x positive, normal, 2^-1021 < result < 2^1023   1
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined CONTRACTS && defined __FP_FAST_FMA
#define FMA(a, b, c) __builtin_fma(a, b, c)
#else
#define FMA(a, b, c) ((a) * (b) + (c))
#endif
#define LANE static inline __attribute__((always_inline))

/* c0 + x (c1 + x (.. + x c5)) */
#define HORNER6(x, c0, c1, c2, c3, c4, c5) FMA(x, FMA(x, FMA(x, FMA(x, FMA(x, c5, c4), c3), c2), c1), c0)
/* The same polynomial, evaluated by pairs with y = x x: fewer operations depend on each other. */
#define PAIRS6(x, y, c0, c1, c2, c3, c4, c5) FMA(y, FMA(y, FMA(x, c5, c4), FMA(x, c3, c2)), FMA(x, c1, c0))

LANE int64_t bits_of(double x) {
   int64_t bits;
   memcpy(&bits, &x, sizeof bits);
   return bits;
}

LANE double double_of(uint64_t bits) {
   double x;
   memcpy(&x, &bits, sizeof x);
   return x;
}

/* negative if |x| > bound, and for NaN: bits of |x| as integers have the order of |x| */
LANE int64_t outside(double x, double bound) {
   return bits_of(bound) - (bits_of(x) & INT64_MAX);
}

static const double to_integer = 0x1.8p52; /* Adding this number to x and subtracting it rounds x to an integer. */

/* value of `far` for a single path, whose code may branch */
enum { ALONE = 2 };

/* Sine and cosine of r + low, |r| <= pi/4. */
LANE void on_quarter(const double r, const double low, double *sine, double *cosine) {
   const double z = r * r, y = z * z;
   const double s = PAIRS6(z, y, -0.16666666666666632, 0.008333333333322418, -0.00019841269829812402,
                           2.755731369357982e-06, -2.505075838538343e-08, 1.5896811852068921e-10);
   const double c = PAIRS6(z, y, 0.0416666666666666, -0.0013888888888874131, 2.4801587289487006e-05,
                           -2.755731435378607e-07, 2.087572347857163e-09, -1.1359658818861251e-11);
   *sine = r + FMA(r, z * s, low);
   const double half = 0.5 * z;
   const double b = 1 - half;
   *cosine = b + (((1 - b) - half) + FMA(y, c, -(r * low)));
}

/* The algorithm of the library's sincos_lanes, whose comments explain it (src/base/sincos.f90). */
LANE void lane_sincos(double x, double *sine, double *cosine, const int far, int64_t *beyond) {
   if (far == 1 && !(fabs(x) <= 1e5)) {
      *sine = sin(x);
      *cosine = cos(x);
      return;
   }
   /* No reduction is needed: the code below would leave x unchanged, and low zero. */
   if (far == ALONE && fabs(x) <= 0.785) {
      on_quarter(x, 0, sine, cosine);
      return;
   }
   const double shifted = FMA(x, 0.6366197723675814, to_integer);
   const uint64_t turn = (uint64_t)bits_of(shifted);
   const double turns = shifted - to_integer;
   const double first = FMA(-turns, 1.5707963267923333, x), second = turns * 2.5633441515839558e-12;
   const double r = first - second;
   const double low = FMA(-turns, 1.0562999066987428e-23, (first - r) - second);
   double a, b;
   on_quarter(r, low, &a, &b);
   const uint64_t a_bits = (uint64_t)bits_of(a), b_bits = (uint64_t)bits_of(b);
   const uint64_t swap = (a_bits ^ b_bits) & -(turn & 1);
   *sine = double_of((a_bits ^ swap) ^ ((turn & 2) << 62));
   *cosine = double_of((b_bits ^ swap) ^ (((turn ^ (turn << 1)) & 2) << 62));
   *beyond |= outside(x, 1e5);
}

/* 2^k exp(r), where `shifted` is k + 2^52 * 1.5: the series up to the power 13, |r| < 0.35. */
LANE double exp_of(double shifted, double r) {
   const double high = HORNER6(r, 2.4801587301587302e-5, 2.7557319223985893e-6, 2.7557319223985888e-7,
                               2.505210838544172e-8, 2.08767569878681e-9, 1.6059043836821613e-10);
   const double poly = HORNER6(r, 0.5, 0.16666666666666666, 0.041666666666666664, 8.333333333333333e-3,
                               1.3888888888888889e-3, FMA(r, high, 1.9841269841269841e-4));
   const double y = 1 + FMA(r * r, poly, r);
   return double_of((uint64_t)bits_of(y) + ((uint64_t)bits_of(shifted) << 52));
}

/* x = k log 2 + r */
LANE double near_exp(double x) {
   const double shifted = FMA(x, 1.4426950408889634, to_integer);
   const double k = shifted - to_integer;
   return exp_of(shifted, FMA(-k, 1.90821492927058770002e-10, FMA(-k, 6.93147180369123816490e-01, x)));
}

/* the upper 21 bits of a mantissa: products of two such numbers have no rounding */
LANE double upper(double x) {
   return double_of((uint64_t)bits_of(x) & UINT64_C(0xffffffff00000000));
}

/* exp(-x^2) for |x| < 26.6, corrected for the rounding error of the square */
LANE double near_gauss(double x) {
   const double high = upper(x), low = (high - x) * (x + high), square = -high * high;
   const double shifted = FMA(square, 1.4426950408889634, to_integer);
   const double k = shifted - to_integer;
   const double r = FMA(-k, 6.93147180369123816490e-01, square);
   return exp_of(shifted, r + FMA(-k, 1.90821492927058770002e-10, low));
}

static inline double plain_gauss(double x) {
   const double size = fabs(x) > 30 ? 30 : fabs(x), high = upper(size);
   return x != x ? x : exp(-high * high) * exp((high - size) * (size + high));
}

/* negative if |x| lies between two bounds, and for NaN; beyond the second bound lanes compute zero themselves */
LANE int64_t between(double x, double bound, double zero) {
   const double size = fabs(x);
   return outside(size > zero ? 0 : size, bound);
}

LANE double lane_gauss(double x, const int far, int64_t *beyond) {
   if (far && between(x, 26.6, 27.3) < 0)
      return plain_gauss(x);
   *beyond |= between(x, 26.6, 27.3);
   const double size = fabs(x);
   return near_gauss(size > 26.6 ? 26.6 : size) * (size > 27.3 ? 0 : 1); /* a choice of the whole is no vector */
}

LANE double lane_exp(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 708))
      return exp(x);
   *beyond |= outside(x, 708);
   return near_exp(x);
}

/* x = 2^k m, positive and normal, with m from `least` < 1 to twice `least`: returns m, and k */
LANE double split(double x, uint64_t least, double *k) {
   const uint64_t excess = (uint64_t)bits_of(x) - least;
   *k = double_of(UINT64_C(0x4330000000000000) | ((excess + (UINT64_C(1024) << 52)) >> 52)) - (0x1p52 + 1024);
   return double_of((uint64_t)bits_of(x) - (excess & UINT64_C(0xfff0000000000000)));
}

/* k log 2 + log(1 + f) + small, with 1 + f between sqrt(1/2) and sqrt(2): the approximation of fdlibm in f/(2 + f). */
LANE double log_of(double k, double f, double small) {
   const double s = f / (2 + f), z = s * s, w = z * z;
   const double even = w * FMA(w, FMA(w, 1.531383769920937332e-01, 2.222219843214978396e-01), 3.999999999940941908e-01);
   const double odd =
       z * FMA(w, FMA(w, FMA(w, 1.479819860510658591e-01, 1.818357216161805012e-01), 2.857142874366239149e-01),
               6.666666666666735130e-01);
   const double square = 0.5 * f * f;
   const double rest = FMA(s, square + (odd + even), small);
   return FMA(k, 6.93147180369123816490e-01, -((square - rest) - f));
}

static const double log_low = 1.90821492927058770002e-10; /* The bits of log 2 below those that log_of multiplies. */
static const uint64_t half_root = UINT64_C(0x3fe6a09e667f3bcd); /* sqrt(1/2) */

/* negative where x is not positive and normal */
LANE int64_t not_normal(double x) {
   const uint64_t bits = (uint64_t)bits_of(x);
   return (int64_t)((bits - UINT64_C(0x0010000000000000)) | (UINT64_C(0x7fefffffffffffff) - bits));
}

LANE double lane_log(double x, const int far, int64_t *beyond) {
   if (far && not_normal(x) < 0)
      return log(x);
   *beyond |= not_normal(x);
   double k;
   const double f = split(x, half_root, &k) - 1;
   return log_of(k, f, k * log_low);
}

/* log(1 + x) for x > -1, corrected for the rounding error of 1 + x */
LANE double near_log1p(double x) {
   double k;
   const double u = 1 + x, lost = x - (u - 1);
   const double f = split(u, half_root, &k) - 1;
   return log_of(k, f, FMA(k, log_low, lost / u));
}

LANE double lane_log1p(double x, const int far, int64_t *beyond) {
   if (far && not_normal(1 + x) < 0)
      return log1p(x);
   *beyond |= not_normal(1 + x);
   return near_log1p(x);
}

/* Near zero a quotient of polynomials (Cephes), elsewhere by exp(2 |x|). */
LANE double lane_tanh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 0x1.fffffffffffffp1023))
      return tanh(x);
   *beyond |= outside(x, 0x1.fffffffffffffp1023);
   const double size = fabs(x), bounded = size > 20 ? 20 : size, z = bounded * bounded;
   const double above =
       FMA(FMA(-9.64399179425052238628e-1, z, -9.92877231001918586564e1), z, -1.61468768441708447952e3);
   const double below =
       FMA(FMA(z + 1.12811678491632931402e2, z, 2.23548839060100448583e3), z, 4.84406305325125486048e3);
   const double small = FMA(bounded * z, above / below, bounded);
   const double large = 1 - 2 / (near_exp(2 * bounded) + 1);
   return copysign(size < 0.625 ? small : large, x);
}

/* sinh(x) for 0 <= x < 1, z = x^2: the series to the power 19 */
LANE double small_sinh(double x, double z) {
   const double high = HORNER6(z, 2.7557319223985893e-06, 2.505210838544172e-08, 1.6059043836821613e-10,
                               7.647163731819816e-13, 2.8114572543455206e-15, 8.22063524662433e-18);
   const double poly = FMA(z, FMA(z, FMA(z, high, 0.0001984126984126984), 0.008333333333333333), 0.16666666666666666);
   return FMA(x * z, poly, x);
}

/* Near zero by a series, elsewhere by exp(|x|). */
LANE double lane_sinh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 708))
      return sinh(x);
   *beyond |= outside(x, 708);
   const double size = fabs(x), z = x * x, y = near_exp(size);
   const double small = small_sinh(size, z), large = 0.5 * y - 0.5 / y;
   return copysign(size < 1 ? small : large, x);
}

LANE double lane_cosh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 708))
      return cosh(x);
   *beyond |= outside(x, 708);
   const double y = near_exp(fabs(x));
   return 0.5 * y + 0.5 / y;
}

static inline double plain_sech(double x) {
   const double y = exp(-fabs(x));
   return 2 * y / (1 + y * y);
}

static inline double plain_csch(double x) {
   const double y = exp(-fabs(x));
   return fabs(x) < 1 ? 1 / sinh(x) : copysign(2 * y / (1 - y * y), x);
}

static inline double plain_coth(double x) {
   return 1 / tanh(x);
}

LANE double lane_sech(double x, const int far, int64_t *beyond) {
   if (far && between(x, 708, 746) < 0)
      return plain_sech(x);
   *beyond |= between(x, 708, 746);
   const double size = fabs(x), y = near_exp(size > 708 ? -708 : -size);
   return size > 746 ? 0 : 2 * y / FMA(y, y, 1);
}

LANE double lane_csch(double x, const int far, int64_t *beyond) {
   if (far && between(x, 708, 746) < 0)
      return plain_csch(x);
   *beyond |= between(x, 708, 746);
   const double size = fabs(x), y = near_exp(size > 708 ? -708 : -size);
   const double quotient = (size < 1 ? 1 : 2 * y) / (size < 1 ? small_sinh(size, size * size) : FMA(-y, y, 1));
   return copysign(size > 746 ? 0 : quotient, x);
}

LANE double lane_coth(double x, const int far, int64_t *beyond) {
   return 1 / lane_tanh(x, far, beyond);
}

static inline double plain_logcosh(double x) {
   const double size = fabs(x), y = sinh(size < 1 ? 0.5 * size : 0);
   return size < 1 ? log1p(2 * y * y) : size - 0.6931471805599453 + log1p(exp(-2 * size));
}

/* log(1 + 2 sinh(x/2)^2), from 1 on |x| - log 2 + log(1 + exp(-2 |x|)) */
LANE double lane_logcosh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 0x1.fffffffffffffp1023))
      return plain_logcosh(x);
   *beyond |= outside(x, 0x1.fffffffffffffp1023);
   const double size = fabs(x), half = 0.5 * size, y = small_sinh(half, half * half);
   const double more = near_log1p(size < 1 ? 2 * y * y : near_exp(size > 100 ? -200 : -2 * size));
   return (size < 1 ? 0 : size - 0.6931471805599453) + more;
}

/* atan(x): from -1/x beyond tan(3 pi/8), from (x - 1)/(x + 1) above 0.66, by a quotient of polynomials (Cephes). */
LANE double lane_atan(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 0x1.fffffffffffffp1023))
      return atan(x);
   *beyond |= outside(x, 0x1.fffffffffffffp1023);
   const double size = fabs(x);
   const double over = size > 2.414213562373095 ? -1 : size - 1, under = size > 2.414213562373095 ? size : size + 1;
   const double r = size > 0.66 ? over / under : size, z = r * r;
   double turn = size > 0.66 ? 0.7853981633974483 : 0, rest = size > 0.66 ? 3.061616997868383e-17 : 0;
   turn = size > 2.414213562373095 ? 1.5707963267948966 : turn;
   rest = size > 2.414213562373095 ? 6.123233995736766e-17 : rest;
   const double above =
       FMA(z,
           FMA(z, FMA(z, FMA(z, -8.750608600031904122785e-1, -1.615753718733365076637e1), -7.500855792314704667340e1),
               -1.228866684490136173410e2),
           -6.485021904942025371773e1);
   const double below = HORNER6(z, 1.945506571482613964425e2, 4.853903996359136964868e2, 4.328810604912902668951e2,
                                1.650270098316988542046e2, 2.485846490142306297962e1, 1.0);
   return copysign(turn + (FMA(r, z * (above / below), r) + rest), x);
}

/* asin(r)/r - 1 by z = r^2 <= 1/4 (fdlibm) */
LANE double more_of_asin(double z) {
   const double above = HORNER6(z, 1.66666666666666657415e-01, -3.25565818622400915405e-01, 2.01212532134862925881e-01,
                                -4.00555345006794114027e-02, 7.91534994289814532176e-04, 3.47933107596021167570e-05);
   const double below =
       FMA(z,
           FMA(z, FMA(z, FMA(z, 7.70381505559019352791e-02, -6.88283971605453293030e-01), 2.02094576023350569471),
               -2.40339491173441421878),
           1);
   return z * (above / below);
}

/* Above 1/2 by the half angle: asin(x) = pi/2 - 2 asin(sqrt((1 - x)/2)). */
LANE double lane_asin(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 1))
      return asin(x);
   *beyond |= outside(x, 1);
   const double size = fabs(x), half = 0.5 * (1 - size), twice = 2 * sqrt(half);
   const double more = more_of_asin(size < 0.5 ? x * x : half);
   const double rest = 0.7853981633974483 - twice; /* The difference is exact where both numbers are close. */
   const double large = 0.7853981633974483 + (rest - FMA(twice, more, -6.123233995736766e-17));
   return copysign(size < 0.5 ? FMA(size, more, size) : large, x);
}

LANE double lane_acos(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 1))
      return acos(x);
   *beyond |= outside(x, 1);
   const double size = fabs(x), half = 0.5 * (1 - size), r = size < 0.5 ? x : 2 * sqrt(half);
   const double y = FMA(r, more_of_asin(size < 0.5 ? x * x : half), r);
   const double middle = 1.5707963267948966 - (y - 6.123233995736766e-17);
   const double large = x < 0 ? 3.141592653589793 - (y - 1.2246467991473532e-16) : y;
   return size < 0.5 ? middle : large;
}

LANE double lane_asinh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 1e150))
      return asinh(x);
   *beyond |= outside(x, 1e150);
   const double size = fabs(x), z = x * x;
   return copysign(near_log1p(size + z / (1 + sqrt(1 + z))), x);
}

LANE double lane_acosh(double x, const int far, int64_t *beyond) {
   if (far && !(x >= 1 && x <= 1e150))
      return acosh(x);
   *beyond |= (bits_of(x) - bits_of(1.0)) | (bits_of(1e150) - bits_of(x));
   const double more = x - 1;
   return near_log1p(more + sqrt(FMA(more, more, 2 * more)));
}

LANE double lane_atanh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) < 1))
      return atanh(x);
   *beyond |= outside(x, 0x1.fffffffffffffp-1);
   const double size = fabs(x), twice = 2 * size;
   return copysign(0.5 * near_log1p(twice + twice * size / (1 - size)), x);
}

/* erf(y)/y - 1 for z = y^2 <= 1, above and below the line: fitted to 7e-19 */
LANE double above_erf(double z) {
   return HORNER6(z, 0.1283791670955126, -0.3170141296970381, -0.048309764364948916, -0.008812531962234244,
                  -0.0004951304464755514, -2.071014803824855e-05);
}

LANE double below_erf(double z) {
   return HORNER6(z, 1.0, 0.4604505596365237, 0.0937841047084297, 0.010687352702938214, 0.0006919161614429158,
                  2.078384613287413e-05);
}

/* Up to 1 a quotient of polynomials, then 1 - exp(-x^2) a/b (Cephes) */
LANE double lane_erf(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 0x1.fffffffffffffp1023))
      return erf(x);
   *beyond |= outside(x, 0x1.fffffffffffffp1023);
   const double size = fabs(x), y = size > 6 ? 6 : size, z = y * y;
   const double over =
       HORNER6(y, 5.57535335369399327526e2, 1.02755188689515710272e3, 9.34528527171957607540e2,
               5.26445194995477358631e2, 1.96520832956077098242e2,
               FMA(y, FMA(y, FMA(y, 2.46196981473530512524e-10, 5.64189564831068821977e-1), 7.46321056442269912687),
                   4.86371970985681366614e1));
   const double under =
       HORNER6(y, 5.57535340817727675546e2, 1.65666309194161350182e3, 2.24633760818710981792e3,
               1.82390916687909736289e3, 9.75708501743205489753e2,
               FMA(y, FMA(y, FMA(y, 1, 1.32281951154744992508e1), 8.67072140885989742329e1), 3.54937778887819891062e2));
   const double quotient = (y < 1 ? above_erf(z) : near_exp(-z) * over) / (y < 1 ? below_erf(z) : under);
   return copysign(y < 1 ? FMA(y, quotient, y) : 1 - quotient, x);
}

/* Up to 1/2 as erf, then exp(-x^2)/(1 + 2 |x|) times a polynomial in (|x| - 4)/(|x| + 4), which was fitted to 5e-17 */
LANE double lane_erfc(double x, const int far, int64_t *beyond) {
   /* 26.5 for 26 < |x| < 27.4 marks a far lane; beyond 27.4 the value at 26 is computed. */
   const double bounded = copysign(between(x, 26, 27.4) < 0 ? 26.5 : fabs(x) > 27 ? 26 : fabs(x), x);
   if (far && outside(bounded, 26) < 0)
      return erfc(x);
   *beyond |= outside(bounded, 26);
   const double size = fabs(bounded), y = size > 26 ? 26 : size, z = y * y, t = (y - 4) / (y + 4);
   const double p3 = HORNER6(t, 7.72670525116309e-08, 1.1070512091540886e-07, -1.9832259612910898e-08,
                             -1.4819951110604989e-08, 2.441955446515271e-09, 1.5612216848786612e-09);
   const double p2 = HORNER6(t, 0.00015062137336285567, -2.4399129119028855e-05, -1.1221043633066066e-05,
                             5.709666307919998e-06, 2.917604010674157e-07, FMA(t, p3, -8.256374167657721e-07));
   const double p1 = HORNER6(t, -0.06633036581170224, 0.0371675155367598, -0.016197734065010017, 0.005031969984621396,
                             -0.0007577732294083494, FMA(t, p2, -0.0001992567277331189));
   const double p0 = HORNER6(t, 1.2329951186255526, -0.1396211168405625, 0.01537965210262002, 0.06809705425469169,
                             -0.10103906603632341, FMA(t, p1, 0.09373283499839018));
   const double above = size < 0.5 ? above_erf(z) : near_gauss(y) * p0,
                below = size < 0.5 ? below_erf(z) : FMA(2, y, 1);
   const double quotient = above / below, whole = size < 0.5 ? 1 : 1 - copysign(1, x);
   const double rest = size < 0.5 ? -FMA(bounded, quotient, bounded) : copysign(quotient, bounded);
   return (whole + rest) * (x > 27.3 ? 0 : 1);
}

/* x^y = 2^(y log2 x), with log2 x in two parts as in fdlibm: x = 2^k m with m near 1 or 3/2 */
LANE double lane_pow(double x, double y, const int far, int64_t *beyond) {
   double k;
   const double m = split(x, UINT64_C(0x3febb67ae8584caa), &k); /* sqrt(3/4) */
   const double base = m < 1.224744871391589 ? 1 : 1.5;
   const double shift = m < 1.224744871391589 ? 0 : 5.84962487220764160156e-01; /* log2 of the base, in two parts */
   const double shift_low = m < 1.224744871391589 ? 0 : 1.35003920212974897128e-08;
   const double u = m - base, v = 1 / (m + base), s = u * v; /* log(m/base) = 2 atanh(s) */
   const double s_high = upper(s), t_high = upper(m + base), t_low = m - (t_high - base);
   const double s_low = v * ((u - s_high * t_high) - s_high * t_low);
   const double z = s * s;
   const double series =
       z * z *
           HORNER6(z, 5.99999999999994648725e-01, 4.28571428578550184252e-01, 3.33333329818377432918e-01,
                   2.72728123808534006489e-01, 2.30660745775561754067e-01, 2.06975017800338417784e-01) +
       s_low * (s_high + s);
   const double square = s_high * s_high;
   const double sum = upper(3 + square + series), sum_low = series - ((sum - 3) - square);
   const double a = s_high * sum, b = s_low * sum + sum_low * s;
   const double p = upper(a + b), p_low = b - (p - a);
   const double c = 9.61796700954437255859e-01 * p; /* 2/(3 log 2), in two parts */
   const double c_low = -7.02846165095275826516e-09 * p + p_low * 9.61796693925975554329e-01 + shift_low;
   const double log2 = upper(((c + c_low) + shift) + k), log2_low = c_low - (((log2 - k) - shift) - c);
   const double y_high = upper(y), high = y_high * log2, low = (y - y_high) * log2 + y * log2_low;
   const double exponent = low + high;
   if (far && ((not_normal(x) | outside(exponent, 1021)) < 0))
      return pow(x, y);
   *beyond |= not_normal(x) | outside(exponent, 1021);
   const double shifted = exponent + to_integer, rest = high - (shifted - to_integer), r = upper(low + rest);
   const double tail = (low - (r - rest)) * 6.93147180559945286227e-01 + r * -1.90465429995776804525e-09;
   return exp_of(shifted, r * 6.93147182464599609375e-01 + tail);
}

/* ---- functions that the C library computes for one lane after the other ---- */

double lgamma_r(double, int *);
double jn(int, double);
double yn(int, double);

static inline double plain_gamma(double x) {
   return tgamma(x);
}

/* log(gamma(x)) for x > 0; elsewhere it is not real */
static inline double plain_loggamma(double x) {
   int sign;
   return x > 0 ? lgamma_r(x, &sign) : NAN;
}

static inline double plain_besselj(int order, double x) {
   return jn(order, x);
}

static inline double plain_bessely(int order, double x) {
   return x > 0 ? yn(order, x) : NAN;
}

/* I_n(x) from the ratios I_k/I_(k-1) = 1/(2 k/x + I_(k+1)/I_k), of high orders first, and exp(x) = I_0 + 2 (I_1 + I_2 +
 * ..), whose terms from order 9 sqrt(x) on are below rounding. No term is subtracted. */
static inline double plain_besseli(int order, double x) {
   const double size = fabs(x), root = exp(0.5 * size);
   double ratio = 0, rest = 0, product = 1; /* rest is (I_k + I_(k+1) + ..)/I_(k-1), product I_order/I_0 */
   for (int k = order + 20 + (int)(9 * sqrt(size < 800 ? size : 800)); k > 0; k--) {
      ratio = 1 / (2 * k / size + ratio);
      rest = ratio * (1 + rest);
      product *= k <= order ? ratio : 1;
   }
   const double value = root / (1 + 2 * rest) * product * root;
   return order % 2 && x < 0 ? -value : value;
}

/* K_0 and K_1 as integrals of exp(-x cosh(s)) and of cosh(s) exp(-x cosh(s)) over s > 0 by trapezoids, whose error falls
 * as exp(-pi^2/step); then K_(n+1) = K_(n-1) + 2 n/x K_n. */
static inline double plain_besselk(int order, double x) {
   if (!(x > 0))
      return NAN;
   if (x > 800)
      return 0;
   const double step = x < 9 ? 0.2 : 0.6 / sqrt(x);
   double low = 0.5, high = 0.5, decay = 0;
   for (int j = 1; j < 4000 && decay < 45; j++) {
      const double half = sinh(0.5 * step * j), more = 2 * half * half; /* cosh(s) - 1 */
      decay = x * more;
      const double term = exp(-decay);
      low += term;
      high += term * (1 + more);
   }
   low *= step * exp(-x);
   high *= step * exp(-x);
   for (int k = 1; k <= order; k++) {
      const double next = low + 2 * k / x * high;
      low = high;
      high = next;
   }
   return low;
}

/* The derivative of order 0 .. 3 of gamma'/gamma: from 16 on by its asymptotic series, below by recurrence, and below
 * 1/2 by its reflection. */
static inline double plain_polygamma(int order, double x) {
   const double pi = 3.141592653589793, flip = order % 2 ? 1 : -1;
   const double factorial = order == 3 ? 6 : order == 2 ? 2 : 1;
   if (x < 0.5) {
      const double c = 1 / tan(pi * x), more = 1 + c * c;
      const double slope = order == 0   ? c
                           : order == 1 ? -pi * more
                           : order == 2 ? 2 * pi * pi * c * more
                                        : -2 * pi * pi * pi * more * (1 + 3 * c * c);
      return -flip * plain_polygamma(order, 1 - x) - pi * slope;
   }
   double y = x, sum = 0;
   for (; y < 16; y++)
      sum += factorial / (order == 0 ? y : order == 1 ? y * y : order == 2 ? y * y * y : y * y * y * y);
   /* Bernoulli numbers B_2 .. B_16 */
   static const double bernoulli[] = {1 / 6.0,  -1 / 30.0,       1 / 42.0, -1 / 30.0,
                                      5 / 66.0, -691 / 2730.0, 7 / 6.0,  -3617 / 510.0};
   const double z = 1 / (y * y);
   double power = z, tail = 0; /* sum of B_2j (2j + order - 1)!/(2j)! y^-2j */
   for (int j = 1; j <= 8; j++, power *= z) {
      double rising = 1;
      for (int k = 1; k < order; k++)
         rising *= 2 * j + k;
      tail += bernoulli[j - 1] * power * (order == 0 ? 1 / (2.0 * j) : rising);
   }
   if (order == 0)
      return log(y) - 0.5 / y - tail - sum;
   double scale = 1 / y;
   for (int k = 1; k < order; k++)
      scale *= k / y; /* (order - 1)!/y^order */
   double root = 1;
   for (int k = 0; k < order; k++)
      root /= y;
   return flip * (scale + 0.5 * factorial * root / y + tail * root + sum);
}
