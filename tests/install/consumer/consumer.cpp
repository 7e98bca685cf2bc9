/* SPDX-License-Identifier: BSD-3-Clause
 * A stranger's program: the installed headers and library, nothing else of the project. */
#include <symsde.hpp>

#include <cmath>
#include <iostream>

int main() {
   const symsde::model kubo("kubo", {{"a", 1.0}, {"sigma", 0.3}});
   symsde::options chosen;
   chosen.step = 0.02;
   chosen.steps = chosen.save_every = 100;
   chosen.paths = 8;
   const double q0[] = {1.0}, p0[] = {0.0};
   const auto found = symsde::simulate(kubo, symsde::scheme("midpoint"), chosen, {q0, p0});
   // The midpoint scheme keeps p^2 + q^2 of the Kubo oscillator.
   const double kept = std::hypot(found.q(1)[7], found.p(1)[7]);
   std::cout << "C++: symsde " << symsde::version() << ", p^2 + q^2 is kept\n";
   return found.status() == SYMSDE_OK && std::abs(kept - 1) < 1e-12 ? 0 : 1;
}
