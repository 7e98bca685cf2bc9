
/* matrix^{-1} r in place of r, without pivots: near the identity none are needed; elsewhere what comes out is no solution,
 * does not converge, and the step is left to the library. */
LANE void eliminate(double matrix[DOF][DOF], double *r) {
   for (int k = 0; k < DOF; k++) {
      const double inverse = 1 / matrix[k][k];
      for (int i = k + 1; i < DOF; i++) {
         const double factor = matrix[i][k] * inverse;
         for (int j = k + 1; j < DOF; j++)
            matrix[i][j] = FMA(-factor, matrix[k][j], matrix[i][j]);
         r[i] = FMA(-factor, r[k], r[i]);
      }
      r[k] *= inverse;
      for (int j = k + 1; j < DOF; j++)
         matrix[k][j] *= inverse;
   }
   for (int k = DOF - 1; k > 0; k--)
      for (int i = 0; i < k; i++)
         r[i] = FMA(-matrix[i][k], r[k], r[i]);
}
