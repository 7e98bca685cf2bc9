/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Your own model in C++: the Duffing oscillator with noise in its stiffness, as in own_model.c.
 *
 *    H = p^2/2 + q^2/2 + q^4/4,   H_1 = sigma q^2/2      (noise that depends on position alone)
 *
 *    c++ -std=c++17 own_model.cpp $(pkg-config --cflags --libs symsde)
 */
#include <cmath>
#include <cstdio>
#include <symsde.hpp>

int main() {
   const double sigma = 0.2;

   // Declared traits decide which work is skipped. A false trait is refused by name.
   symsde::traits declared(1, 1);
   declared.separable = declared.position_noise = declared.identity_mass = 1;

   // Gradient of w[0] H + w[1] H_1 for a block of paths, one lane for each path.
   symsde::functions duffing;
   duffing.gradient = [sigma](const symsde::block &at, auto hq, auto hp) {
      const auto q = at.q[0], p = at.p[0], h = at.w[0], dw = at.w[1];
      for (std::size_t i = 0; i < at.lanes; i++) {
         hq[0][i] = h[i] * (q[i] + q[i] * q[i] * q[i]) + dw[i] * sigma * q[i];
         hp[0][i] = h[i] * p[i];
      }
   };

   symsde::options chosen;
   chosen.step = 0.02;
   chosen.steps = 500;
   chosen.paths = 1000;
   chosen.seed = 42;
   chosen.save_every = 100;

   try {
      const symsde::model model("duffing", declared, duffing);
      const symsde::scheme scheme("stormer_verlet");
      const double q0[] = {1.0}, p0[] = {0.0}; // one state for all paths
      const auto run = symsde::simulate(model, scheme, chosen, {q0, p0});
      double mean = 0;
      for (const double q : run.q(5)) {
         mean += q / 1000;
      }
      std::printf("stepper: %s; left out: %s\n", run.report.stepper, run.report.left_out);
      std::printf("mean of q at t = %.1f over 1000 paths: %.4f\n", run.t[5], mean);
      return run.status() == SYMSDE_OK && std::isfinite(mean) ? 0 : 1;
   } catch (const symsde::error &refused) {
      std::fprintf(stderr, "status %d: %s\n", refused.code(), refused.what());
      return 1;
   }
}
