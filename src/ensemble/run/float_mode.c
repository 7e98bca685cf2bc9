/* SPDX-License-Identifier: BSD-3-Clause
 * What decides about the bits of sums beside their terms: how a thread rounds, and, where that is in the same register (x86,
 * aarch64), whether it keeps denormal numbers. Traps and flags are left as they are. */
#define HIDDEN __attribute__((visibility("hidden")))

HIDDEN int float_mode(void);
HIDDEN void set_float_mode(int mode);

#if defined(__SSE2__)
#include <xmmintrin.h>

#define MODE 0xe040u /* bits of MXCSR: flush to zero, rounding, denormals are zeros */

static unsigned control(void) {
   return _mm_getcsr();
}

static void set_control(unsigned bits) {
   _mm_setcsr(bits);
}
#elif defined(__aarch64__)
#define MODE 0x1c00000u /* bits of FPCR: flush to zero, which also reads denormals as zeros; rounding */

static unsigned control(void) {
   unsigned long long bits;
   __asm__ volatile("mrs %0, fpcr" : "=r"(bits));
   return (unsigned)bits; /* the upper half is reserved, and zero */
}

static void set_control(unsigned bits) {
   __asm__ volatile("msr fpcr, %0" : : "r"((unsigned long long)bits));
}
#else
#include <fenv.h>

#define MODE (~0u) /* rounding mode alone */

static unsigned control(void) {
   return (unsigned)fegetround();
}

static void set_control(unsigned bits) {
   fesetround((int)bits);
}
#endif

int float_mode(void) {
   return (int)(control() & MODE);
}

void set_float_mode(int mode) {
   set_control((control() & ~MODE) | (unsigned)mode);
}
