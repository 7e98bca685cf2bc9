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

/* negative where |x| > bound, and for NaN: as integers the bits of |x| are ordered as |x| */
LANE int64_t outside(double x, double bound) {
   return bits_of(bound) - (bits_of(x) & INT64_MAX);
}

static const double to_integer = 0x1.8p52; /* x + this - this rounds x to an integer */

/* The algorithm of the library's sincos_lanes, whose comments explain it (src/base/sincos.f90). */
LANE void lane_sincos(double x, double *sine, double *cosine, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 1e5)) {
      *sine = sin(x);
      *cosine = cos(x);
      return;
   }
   const double shifted = FMA(x, 0.6366197723675814, to_integer);
   const uint64_t turn = (uint64_t)bits_of(shifted);
   const double turns = shifted - to_integer;
   const double first = FMA(-turns, 1.5707963267923333, x), second = turns * 2.5633441515839558e-12;
   const double r = first - second;
   const double low = FMA(-turns, 1.0562999066987428e-23, (first - r) - second);
   const double z = r * r;
   const double s = HORNER6(z, -0.16666666666666632, 0.008333333333322418, -0.00019841269829812402,
                            2.755731369357982e-06, -2.505075838538343e-08, 1.5896811852068921e-10);
   const double c = HORNER6(z, 0.0416666666666666, -0.0013888888888874131, 2.4801587289487006e-05,
                            -2.755731435378607e-07, 2.087572347857163e-09, -1.1359658818861251e-11);
   const double a = r + FMA(r, z * s, low);
   const double half = 0.5 * z;
   double b = 1 - half;
   b = b + (((1 - b) - half) + FMA(z * z, c, -(r * low)));
   const uint64_t a_bits = (uint64_t)bits_of(a), b_bits = (uint64_t)bits_of(b);
   const uint64_t swap = (a_bits ^ b_bits) & -(turn & 1);
   *sine = double_of((a_bits ^ swap) ^ ((turn & 2) << 62));
   *cosine = double_of((b_bits ^ swap) ^ (((turn ^ (turn << 1)) & 2) << 62));
   *beyond |= outside(x, 1e5);
}

/* x = k log 2 + r, the series of exp(r) to the power 13, and k added to the exponent. */
LANE double near_exp(double x) {
   const double shifted = FMA(x, 1.4426950408889634, to_integer);
   const double k = shifted - to_integer;
   const double r = FMA(-k, 1.90821492927058770002e-10, FMA(-k, 6.93147180369123816490e-01, x));
   const double high = HORNER6(r, 2.4801587301587302e-5, 2.7557319223985893e-6, 2.7557319223985888e-7,
                               2.505210838544172e-8, 2.08767569878681e-9, 1.6059043836821613e-10);
   const double poly = HORNER6(r, 0.5, 0.16666666666666666, 0.041666666666666664, 8.333333333333333e-3,
                               1.3888888888888889e-3, FMA(r, high, 1.9841269841269841e-4));
   const double y = 1 + FMA(r * r, poly, r);
   return double_of((uint64_t)bits_of(y) + ((uint64_t)bits_of(shifted) << 52));
}

LANE double lane_exp(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 708))
      return exp(x);
   *beyond |= outside(x, 708);
   return near_exp(x);
}

/* x = 2^k (1 + f) with 1 + f between sqrt(1/2) and sqrt(2); the approximation of fdlibm in f/(2 + f). */
LANE double lane_log(double x, const int far, int64_t *beyond) {
   const uint64_t smallest = UINT64_C(0x0010000000000000), largest = UINT64_C(0x7fefffffffffffff);
   const uint64_t bits = (uint64_t)bits_of(x);
   if (far && !(bits >= smallest && bits <= largest))
      return log(x);
   *beyond |= (int64_t)((bits - smallest) | (largest - bits));
   const uint64_t excess = bits - UINT64_C(0x3fe6a09e667f3bcd);
   const double k =
       double_of(UINT64_C(0x4330000000000000) | ((excess + (UINT64_C(1024) << 52)) >> 52)) - (0x1p52 + 1024);
   const double f = double_of(bits - (excess & UINT64_C(0xfff0000000000000))) - 1;
   const double s = f / (2 + f), z = s * s, w = z * z;
   const double even = w * FMA(w, FMA(w, 1.531383769920937332e-01, 2.222219843214978396e-01), 3.999999999940941908e-01);
   const double odd =
       z * FMA(w, FMA(w, FMA(w, 1.479819860510658591e-01, 1.818357216161805012e-01), 2.857142874366239149e-01),
               6.666666666666735130e-01);
   const double square = 0.5 * f * f;
   const double rest = FMA(s, square + (odd + even), k * 1.90821492927058770002e-10);
   return FMA(k, 6.93147180369123816490e-01, -((square - rest) - f));
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

/* Near zero the series to the power 19, elsewhere by exp(|x|). */
LANE double lane_sinh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 708))
      return sinh(x);
   *beyond |= outside(x, 708);
   const double size = fabs(x), z = x * x, y = near_exp(size);
   const double high = HORNER6(z, 2.7557319223985893e-06, 2.505210838544172e-08, 1.6059043836821613e-10,
                               7.647163731819816e-13, 2.8114572543455206e-15, 8.22063524662433e-18);
   const double poly = FMA(z, FMA(z, FMA(z, high, 0.0001984126984126984), 0.008333333333333333), 0.16666666666666666);
   const double small = FMA(size * z, poly, size), large = 0.5 * y - 0.5 / y;
   return copysign(size < 1 ? small : large, x);
}

LANE double lane_cosh(double x, const int far, int64_t *beyond) {
   if (far && !(fabs(x) <= 708))
      return cosh(x);
   *beyond |= outside(x, 708);
   const double y = near_exp(fabs(x));
   return 0.5 * y + 0.5 / y;
}

/* By -1/x beyond tan(3 pi/8), by (x - 1)/(x + 1) above 0.66, and a quotient of polynomials (Cephes). */
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
