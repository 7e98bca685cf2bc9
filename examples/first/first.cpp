/* SPDX-License-Identifier: BSD-3-Clause
 *
 * First run in C++: means of 10 000 Kubo oscillators, and one path.
 *
 *    c++ -std=c++17 first.cpp $(pkg-config --cflags --libs symsde) -o first && ./first
 */
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <symsde.hpp>

int main() {
   symsde::options options;
   options.step = 0.02;
   options.steps = 500;
   options.save_every = 50;
   options.paths = 10000;
   options.seed = 1;
   const double q0[] = {1.0}, p0[] = {0.0}; // one state for all paths

   try {
      // dp = -a q dt - sigma q o dW, dq = a p dt + sigma p o dW: a rotation with a random angular velocity
      const symsde::model model("kubo", {{"a", 1.0}, {"sigma", 0.3}});
      const symsde::scheme scheme("midpoint");

      const auto moments = symsde::compute_moments(model, scheme, options, {q0, p0});
      const std::size_t last = moments.t.size() - 1;
      const double t = moments.t[last];
      std::printf("E q = %.8f +- %.8f at t = %.1f, exact %.8f\n", moments.mean(last)[0], moments.se_mean(last)[0], t,
                  std::exp(-0.045 * t) * std::cos(t));

      options.paths = 100; // save the first 100 of these paths: run.q(time) holds all paths
      const auto run = symsde::simulate(model, scheme, options, {q0, p0});
      double moved = 0.0;
      for (std::size_t n = 0; n <= last; n++) {
         for (std::size_t i = 0; i < 100; i++) {
            const double q = run.q(n)[i], p = run.p(n)[i];
            moved = std::max(moved, std::abs(q * q + p * p - 1.0));
         }
      }
      std::printf("path 0 ends at q = %.8f, p = %.8f\n", run.q(last)[0], run.p(last)[0]);
      std::puts(moved < 1e-12 ? "p^2 + q^2 is kept to 1e-12 on every path" : "p^2 + q^2 has moved");
      return moments.status() == SYMSDE_OK && run.status() == SYMSDE_OK ? 0 : 1;
   } catch (const symsde::error &refused) {
      std::fprintf(stderr, "%s\n", refused.what());
      return 1;
   }
}
