
/* `was` if `rests` is -1, `next` if `rests` is 0. */
LANE double either(const int64_t rests, const double was, const double next) {
   return double_of(((uint64_t)bits_of(was) & (uint64_t)rests) | ((uint64_t)bits_of(next) & ~(uint64_t)rests));
}

/* The library's test for matrices that are derivatives of their residuals (src/solve/stagnation.f90): the size of
 * the correction, or done (-1), or failed (-2), for example if d is NaN. Corrections that do not shrink may lead to
 * another solution than the library's: such lanes fail here, and are rescued by the library. */
LANE double verdict(const double d, const double size, const double last) {
   const double near = 0x1p-33 * size, eighth = 0x1p-3 * last, less = near < eighth ? near : eighth;
   double bound = d < last ? less : near;
   bound = bound > 0x1p-54 * size ? bound : 0x1p-54 * size;
   bound = d <= 0x1p-20 * last ? 0x1p-20 * size : bound;
   const double next = d < last ? d : -2;
   return d <= bound ? -1 : next;
}

/* The verdict on a first correction. */
LANE double first_verdict(const double d, const double size) {
   const double next = d <= 0x1.fffffffffffffp1023 ? d : -2;
   return d <= 0x1p-33 * size ? -1 : next;
}

/* The verdict on sweeps, as in src/step/stages/fixed_point.f90: done if the next change would vanish or be rounding;
 * left (-2) if changes do not shrink fast enough, or are not finite. */
LANE double sweep_verdict(const double d, const double size, const double last) {
   const double rounding = 0x1p-54 * size, near = 0x1p-33 * size;
   const double slow = 0.2 * last, bound = slow > near ? slow : near;
   double next = d <= bound ? d : -2;
   next = d <= near ? (d >= last ? -1 : next) : next;
   return d * 0x1p-13 <= rounding ? (d * d <= rounding * last ? -1 : next) : next;
}
