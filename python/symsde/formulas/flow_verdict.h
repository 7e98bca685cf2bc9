
/* The library's test for matrices that are derivatives of their residuals (src/solve/stagnation.f90): the size of the
 * correction, or done (-1), or failed (-2). Corrections that grow may lead to another solution than the library's: such
 * lanes fail here, and are rescued by the library. */
LANE double verdict(const double d, const double size, const double last) {
   double bound = d <= 0x1p-3 * last ? 0x1p21 : 1;
   bound = 0x1p-54 * size * (d <= 0x1p-20 * last ? 0x1p34 : bound);
   bound = d >= last ? 0x1p-33 * size : bound;
   double next = d <= bound ? -1 : d;
   next = last > 0 && d > last && d > bound ? -2 : next;
   next = d + size <= 0x1.fffffffffffffp1023 ? next : -2;
   return last >= 0 ? next : last;
}
