/* SPDX-License-Identifier: BSD-3-Clause
 *
 * Your own model in C++: a pendulum that is shaken sideways.
 *
 *    H = p^2/2 - cos q,   H_1 = sigma sin q      (noise that depends on position alone)
 *
 *    c++ -std=c++17 own_model.cpp $(pkg-config --cflags --libs symsde) -o own_model && ./own_model
 */
#include <cmath>
#include <cstdio>
#include <symsde.hpp>
#include <vector>

int main() {
   const double sigma = 0.3;

   // Declared traits decide which work is skipped. A false trait is refused by name.
   symsde::traits declared(1, 1);
   declared.separable = declared.position_noise = declared.identity_mass = 1;

   // Gradient of w[0] H + w[1] H_1 for a block of paths, one lane for each path.
   symsde::functions pendulum;
   pendulum.gradient = [sigma](const symsde::block &at, auto hq, auto hp) {
      const auto q = at.q[0], p = at.p[0], h = at.w[0], dw = at.w[1];
      std::vector<double> sine(at.lanes), cosine(at.lanes);
      symsde_sincos(static_cast<int>(at.lanes), &q[0], sine.data(), cosine.data());
      for (std::size_t i = 0; i < at.lanes; i++) {
         hq[0][i] = h[i] * sine[i] + dw[i] * sigma * cosine[i];
         hp[0][i] = h[i] * p[i];
      }
   };
   // Second derivatives. They are optional: without them they are approximated by differences of gradients.
   pendulum.hessian = [sigma](const symsde::block &at, auto hqq, auto hqp, auto hpp) {
      const auto q = at.q[0], h = at.w[0], dw = at.w[1];
      std::vector<double> sine(at.lanes), cosine(at.lanes);
      symsde_sincos(static_cast<int>(at.lanes), &q[0], sine.data(), cosine.data());
      for (std::size_t i = 0; i < at.lanes; i++) {
         hqq(0, 0)[i] = h[i] * cosine[i] - dw[i] * sigma * sine[i];
         hqp(0, 0)[i] = 0.0;
         hpp(0, 0)[i] = h[i];
      }
   };

   symsde::options chosen;
   chosen.step = 0.05;
   chosen.steps = chosen.save_every = 200;
   chosen.paths = 20000;
   chosen.seed = 3;

   try {
      const symsde::model model("pendulum", declared, pendulum);
      const symsde::scheme scheme("midpoint");
      const double q0[] = {1.0}, p0[] = {0.0}; // one state for all paths
      const auto found = symsde::compute_moments(model, scheme, chosen, {q0, p0});
      std::printf("E q = %.6f +- %.6f at t = %.1f\n", found.mean(1)[0], found.se_mean(1)[0], found.t[1]);
      std::printf("stepper: %s; left out: %s\n", found.report.stepper, found.report.left_out);
      return found.status() == SYMSDE_OK && std::isfinite(found.mean(1)[0]) ? 0 : 1;
   } catch (const symsde::error &refused) {
      std::fprintf(stderr, "status %d: %s\n", refused.code(), refused.what());
      return 1;
   }
}
