/* SPDX-License-Identifier: BSD-3-Clause
 * What decides about the bits of sums beside their terms: how a thread rounds, and, where that is in the same register of
 * an x86 processor, whether it keeps denormal numbers. Traps and flags are left as they are. */
#include <fenv.h>

#define HIDDEN __attribute__((visibility("hidden")))

HIDDEN int float_mode(void);
HIDDEN void set_float_mode(int mode);

#if defined(__SSE2__)
#include <xmmintrin.h>

#define MODE 0xe040u /* of MXCSR: flush to zero, rounding, denormals are zeros */

int float_mode(void) {
   return (int)(_mm_getcsr() & MODE);
}

void set_float_mode(int mode) {
   _mm_setcsr((_mm_getcsr() & ~MODE) | (unsigned)mode);
}
#else
int float_mode(void) {
   return fegetround();
}

void set_float_mode(int mode) {
   fesetround(mode);
}
#endif
