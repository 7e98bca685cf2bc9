/* SPDX-License-Identifier: BSD-3-Clause
 *
 * symsde.hpp: values, sentences, callbacks with captures, exceptions that cross the library, handles that free themselves.
 */
#include <symsde.hpp>

#include <array>
#include <atomic>
#include <cmath>
#include <iostream>
#include <string>
#include <vector>

namespace {

int passed = 0, failed = 0;

void check(bool condition, const char *text, int line) {
   (condition ? passed : failed)++;
   if (!condition) {
      std::cout << "line " << line << ": failed: " << text << "\n";
   }
}
#define CHECK(condition) check((condition), #condition, __LINE__)

/* The call throws symsde::error with this code and a message with these words. */
template <class Call> void expect(int code, const std::string &words, Call &&call, int line) {
   try {
      call();
      check(false, "nothing was thrown", line);
   } catch (const symsde::error &caught) {
      const bool good = caught.code() == code && std::string(caught.what()).find(words) != std::string::npos;
      check(good, (std::to_string(caught.code()) + ": " + caught.what()).c_str(), line);
   }
}
#define EXPECT(code, words, call) expect((code), (words), [&] { (void)(call); }, __LINE__)

struct own_exception {
   int number;
};
/* An exception thrown inside a callback reaches the caller unchanged. */
template <class Call> int thrown_number(Call &&call) {
   try {
      call();
   } catch (const own_exception &caught) {
      return caught.number;
   }
   return 0;
}

symsde::options some_options(std::int64_t steps, std::int64_t paths) {
   symsde::options chosen;
   chosen.step = 0.02;
   chosen.steps = steps;
   chosen.paths = paths;
   chosen.seed = 7;
   chosen.save_every = steps / 2;
   return chosen;
}

const std::array<double, 1> one{1.0}, zero{0.0}, half{0.5};

/* A pendulum, H = p^2/2 - cos q, H_1 = sigma sin q; counts calls, and throws from time `refuse` on */
symsde::model pendulum(double sigma, std::atomic<int> &calls, double refuse = 1e300) {
   symsde::traits declared(1, 1);
   declared.separable = declared.position_noise = declared.identity_mass = 1;
   symsde::functions own;
   own.gradient = [sigma, refuse, &calls](const symsde::block &at, auto hq, auto hp) {
      calls++;
      if (at.t > refuse) {
         throw own_exception{17};
      }
      for (std::size_t i = 0; i < at.lanes; i++) {
         hq[0][i] = at.w[0][i] * std::sin(at.q[0][i]) + at.w[1][i] * sigma * std::cos(at.q[0][i]);
         hp[0][i] = at.w[0][i] * at.p[0][i];
      }
   };
   own.value = [sigma](const symsde::block &at, auto value) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         const double q = at.q[0][i], p = at.p[0][i];
         value[i] = at.w[0][i] * (p * p / 2 - std::cos(q)) + at.w[1][i] * sigma * std::sin(q);
      }
   };
   own.hessian = [sigma](const symsde::block &at, auto hqq, auto hqp, auto hpp) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         hqq(0, 0)[i] = at.w[0][i] * std::cos(at.q[0][i]) - at.w[1][i] * sigma * std::sin(at.q[0][i]);
         hqp(0, 0)[i] = 0;
         hpp(0, 0)[i] = at.w[0][i];
      }
   };
   return {"own pendulum", declared, std::move(own)};
}

void texts() {
   CHECK(symsde::version() == TEST_VERSION);
   CHECK(symsde::build_info().find("version: " TEST_VERSION) != std::string::npos);
   CHECK(symsde::model::names().find("kubo") != std::string::npos);
   CHECK(symsde::scheme::names().find("midpoint") != std::string::npos);
   CHECK(symsde::scheme("midpoint").certificate().find("symplectic") != std::string::npos);
}

/* The midpoint rule keeps p^2 + q^2 of the Kubo oscillator; its increments and its paths are those of symsde.h. */
void built_in() {
   const symsde::model kubo("kubo", {{"a", 1.0}, {"sigma", 0.3}});
   const symsde::scheme midpoint("midpoint");
   const auto chosen = some_options(100, 50);
   const auto found = symsde::simulate(kubo, midpoint, chosen, {one, zero});
   CHECK(found.status() == SYMSDE_OK);
   CHECK(found.t.size() == 3 && std::abs(found.t[2] - 2.0) < 1e-14);
   CHECK(found.q(2).size() == 50 && found.path_status.size() == 50 && found.failed_step[0] == -1);
   double largest = 0, spread = 0;
   for (std::size_t i = 0; i < 50; i++) {
      const double q = found.q(2)[i], p = found.p(2)[i];
      largest = std::max(largest, std::abs(q * q + p * p - 1));
      spread = std::max(spread, std::abs(q - found.q(2)[0]));
   }
   CHECK(largest < 1e-13);
   CHECK(spread > 0.1);
   CHECK(found.report.path_steps == 5000);
   /* one step by hand: the tangent of half of its angle is half of a h + sigma dW */
   auto once = some_options(2, 50);
   once.save_every = 1;
   const auto dw = symsde::increments(kubo, midpoint, once);
   const auto first = symsde::simulate(kubo, midpoint, once, {one, zero});
   double away = 0;
   for (std::size_t i = 0; i < 50; i++) {
      const double angle = 2 * std::atan((0.02 + 0.3 * dw[i]) / 2);
      away = std::max(away, std::abs(first.q(1)[i] - std::cos(angle)) + std::abs(first.p(1)[i] + std::sin(angle)));
   }
   CHECK(dw.size() == 100 && away < 1e-14);
   /* a start for each path: path 3 starts elsewhere, and the other paths keep their bits */
   std::vector<double> q0(50, 1.0), p0(50, 0.0);
   q0[3] = 2.0;
   const auto other = symsde::simulate(kubo, midpoint, chosen, {q0, p0});
   CHECK(std::abs(std::hypot(other.q(2)[3], other.p(2)[3]) - 2) < 1e-13);
   CHECK(other.q(2)[4] == found.q(2)[4] && other.q(2)[3] != found.q(2)[3]);
   const double here[] = {1.0}, slope[] = {0.2}, increment[] = {0.1};
   CHECK(symsde::symplecticity(kubo, midpoint, chosen, {here, slope}, increment)[0] < 1e-13);
   CHECK(symsde::symplecticity(kubo, symsde::scheme("heun"), chosen, {here, slope}, increment)[0] > 1e-8);
   const double node[] = {0.5}, weight[] = {1.0};
   const symsde::scheme quadrature(node, weight, 1, "mine");
   const auto same = symsde::simulate(kubo, quadrature, chosen, {one, zero});
   CHECK(std::string(quadrature.info().name) == "mine" && std::abs(same.q(2)[7] - found.q(2)[7]) < 1e-12);
}

/* Path i has the bits of a run of path i alone, and, to rounding, those of the model with its numbers. */
void by_path() {
   std::vector<double> a(50), sigma(50);
   for (std::size_t i = 0; i < 50; i++) {
      a[i] = 1 + 0.01 * static_cast<double>(i);
      sigma[i] = 0.3 + 0.2 * std::cos(0.7 * static_cast<double>(i));
   }
   const symsde::scheme midpoint("midpoint");
   const auto all = symsde::simulate(symsde::model::by_path("kubo", {{"a", a}, {"sigma", sigma}}), midpoint,
                                     some_options(100, 50), {one, zero});
   auto chosen = some_options(100, 1);
   chosen.first_path = 7;
   const double frequency[] = {a[7]}, noise[] = {sigma[7]};
   const auto alone = symsde::simulate(symsde::model::by_path("kubo", {{"a", frequency}, {"sigma", noise}}), midpoint,
                                       chosen, {one, zero});
   const auto plain =
       symsde::simulate(symsde::model("kubo", {{"a", a[7]}, {"sigma", sigma[7]}}), midpoint, chosen, {one, zero});
   CHECK(alone.q(2)[0] == all.q(2)[7] && alone.p(2)[0] == all.p(2)[7]);
   CHECK(std::abs(plain.q(2)[0] - all.q(2)[7]) + std::abs(plain.p(2)[0] - all.p(2)[7]) < 1e-12);
   CHECK(std::abs(all.q(2)[7] - all.q(2)[8]) > 1e-3);
   EXPECT(SYMSDE_WRONG_SHAPE, "parameter sigma of model 'kubo' has 1 numbers, and a has 50",
          symsde::model::by_path("kubo", {{"a", a}, {"sigma", noise}}));
   EXPECT(SYMSDE_UNKNOWN_NAME, "sigm", symsde::model::by_path("kubo", {{"sigm", sigma}}));
   EXPECT(SYMSDE_INCOMPATIBLE, "alpha", symsde::model::by_path("henon_heiles", {{"alpha", a}}));
}

void own_model() {
   std::atomic<int> calls{0};
   const auto mine = pendulum(0.4, calls);
   CHECK(mine.declared().ndof == 1 && mine.declared().has_value == 1 && mine.declared().has_hessian == 1);
   const auto chosen = some_options(200, 33);
   for (const char *name : {"midpoint", "stormer_verlet"}) {
      const symsde::scheme by(name);
      const auto found = symsde::simulate(mine, by, chosen, {half, zero});
      CHECK(found.status() == SYMSDE_OK && calls > 0);
      /* in blocks of other sizes, on one thread: the same bits */
      auto alone = chosen;
      alone.threads = 1;
      alone.lanes = 8;
      const auto again = symsde::simulate(mine, by, alone, {half, zero});
      bool same = true;
      for (std::size_t i = 0; i < 33; i++) {
         same = same && found.q(2)[i] == again.q(2)[i] && found.p(2)[i] == again.p(2)[i];
      }
      CHECK(same);
      /* a path without noise keeps H to the order of the scheme */
      const auto quiet = symsde::simulate(pendulum(0.0, calls), by, chosen, {half, zero});
      const double q = quiet.q(2)[5], p = quiet.p(2)[5];
      CHECK(std::abs(p * p / 2 - std::cos(q) + std::cos(0.5)) < 1e-4);
   }
   /* mean and variance of an observable against those of saved paths */
   const double scale = 3;
   const symsde::observables asked{2, [scale](double t, auto q, auto p, auto values) {
                                      for (std::size_t i = 0; i < q[0].size(); i++) {
                                         values[0][i] = scale * q[0][i];
                                         values[1][i] = t + p[0][i] * p[0][i];
                                      }
                                   }};
   const symsde::scheme by("midpoint");
   const auto found = symsde::simulate(mine, by, chosen, {half, zero});
   const auto means = symsde::compute_moments(mine, by, chosen, {half, zero}, asked);
   double q = 0, pp = 0;
   for (std::size_t i = 0; i < 33; i++) {
      q += found.q(2)[i] / 33;
      pp += found.p(2)[i] * found.p(2)[i] / 33;
   }
   CHECK(means.status() == SYMSDE_OK && means.values == 5 && means.n_ok[2] == 33);
   CHECK(std::abs(means.mean(2)[0] - q) < 1e-13 && std::abs(means.mean(2)[3] - 3 * q) < 1e-12);
   CHECK(std::abs(means.mean(2)[4] - (4.0 + pp)) < 1e-12);
   CHECK(std::abs(means.variance(2)[3] - 9 * means.variance(2)[0]) < 1e-12 && means.variance(2)[0] > 0);
   CHECK(std::abs(means.se_mean(2)[0] - std::sqrt(means.variance(2)[0] / 33)) < 1e-13);
}

/* The pendulum of the catalogue, written as a user's model. */
void beside_the_catalogue() {
   const double sigma = 0.4;
   symsde::traits declared(1, 1);
   declared.separable = declared.identity_mass = 1;
   symsde::functions own;
   own.gradient = [sigma](const symsde::block &at, auto hq, auto hp) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         hq[0][i] = at.w[0][i] * std::sin(at.q[0][i]) + at.w[1][i] * sigma * at.q[0][i];
         hp[0][i] = (at.w[0][i] + at.w[1][i] * sigma) * at.p[0][i];
      }
   };
   const symsde::model library("pendulum", {{"sigma", sigma}}), mine("mine", declared, own);
   const auto chosen = some_options(200, 33);
   for (const char *name : {"midpoint", "stormer_verlet"}) {
      const symsde::scheme by(name);
      const auto a = symsde::simulate(library, by, chosen, {half, zero});
      const auto b = symsde::simulate(mine, by, chosen, {half, zero});
      CHECK(std::abs(a.q(2)[32] - b.q(2)[32]) < 1e-10 && std::abs(a.p(1)[7] - b.p(1)[7]) < 1e-10);
      CHECK(a.q(2)[32] != a.q(2)[31]);
   }
}

/* Products with the Hessian instead of the Hessian: two degrees of freedom, solved by Krylov or fixed point, agree. */
void several() {
   symsde::traits declared(2, 1);
   symsde::functions own;
   own.gradient = [](const symsde::block &at, auto hq, auto hp) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         for (std::size_t k = 0; k < at.ndof; k++) {
            hq[k][i] = at.w[0][i] * (2 * at.q[k][i] - at.q[1 - k][i]) + at.w[1][i] * 0.1 * at.q[k][i];
            hp[k][i] = at.w[0][i] * at.p[k][i] * static_cast<double>(k + 1);
         }
      }
   };
   const auto gradient = own.gradient;
   auto with_matrix = own;
   with_matrix.hessian = [](const symsde::block &at, auto hqq, auto hqp, auto hpp) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         for (std::size_t j = 0; j < 2; j++) {
            for (std::size_t k = 0; k < 2; k++) {
               hqq(j, k)[i] = j == k ? 2 * at.w[0][i] + 0.1 * at.w[1][i] : -at.w[0][i];
               hqp(j, k)[i] = 0;
               hpp(j, k)[i] = j == k ? at.w[0][i] * static_cast<double>(k + 1) : 0;
            }
         }
      }
   };
   own.hessian_vector = [gradient](const symsde::block &at, auto vq, auto vp, auto uq, auto up) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         for (std::size_t k = 0; k < 2; k++) {
            uq[k][i] = at.w[0][i] * (2 * vq[k][i] - vq[1 - k][i]) + at.w[1][i] * 0.1 * vq[k][i];
            up[k][i] = at.w[0][i] * vp[k][i] * static_cast<double>(k + 1);
         }
      }
   };
   const symsde::model products("products", declared, own), matrix("matrix", declared, with_matrix);
   CHECK(products.declared().has_hessian_vector == 1 && products.declared().has_hessian == 0);
   const auto chosen = some_options(40, 9);
   const std::vector<double> q0{1.0, -0.5}, p0{0.0, 0.25};
   const symsde::scheme by("gauss2");
   const auto a = symsde::simulate(products, by, chosen, {q0, p0}), b = symsde::simulate(matrix, by, chosen, {q0, p0});
   CHECK(std::abs(a.q(2, 0)[8] - b.q(2, 0)[8]) < 1e-10 && std::abs(a.p(2, 1)[8] - b.p(2, 1)[8]) < 1e-10);
   const std::vector<double> three{1.0, 2.0, 3.0};
   EXPECT(SYMSDE_WRONG_SHAPE, "3 numbers for p", symsde::simulate(matrix, by, chosen, {q0, three}));
   CHECK(a.q(0, 1)[3] == -0.5 && a.p(0, 1)[3] == 0.25 && a.q(2, 0)[8] != a.q(2, 1)[8]);
   const double dw[] = {0.1};
   CHECK(symsde::symplecticity(matrix, by, chosen, {q0, p0}, dw)[0] < 1e-12);
}

void errors() {
   const symsde::model kubo("kubo");
   const symsde::scheme midpoint("midpoint");
   EXPECT(SYMSDE_UNKNOWN_NAME, "kubbo", symsde::model("kubbo"));
   EXPECT(SYMSDE_UNKNOWN_NAME, "sigm", symsde::model("kubo", {{"sigm", 1.0}}));
   EXPECT(SYMSDE_UNKNOWN_NAME, "midpiont", symsde::scheme("midpiont"));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "gradient", symsde::model("empty", symsde::traits(1, 1), {}));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "step", symsde::simulate(kubo, midpoint, symsde::options(), {one, zero}));
   auto chosen = some_options(4, 3);
   chosen.save_every = 0;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "save_every", symsde::simulate(kubo, midpoint, chosen, {one, zero}));
   chosen.save_every = 3;
   EXPECT(SYMSDE_INVALID_ARGUMENT, "save_every", symsde::simulate(kubo, midpoint, chosen, {one, zero}));
   chosen = some_options(4, -3);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "-3", symsde::simulate(kubo, midpoint, chosen, {one, zero}));
   chosen = some_options(std::int64_t{1} << 62, 3);
   chosen.save_every = 1;
   EXPECT(SYMSDE_OUT_OF_MEMORY, "fit into memory", symsde::simulate(kubo, midpoint, chosen, {one, zero}));
   chosen = some_options(4, 3);
   const std::vector<double> none, two{1.0, 2.0};
   EXPECT(SYMSDE_WRONG_SHAPE, "0 numbers for q", symsde::simulate(kubo, midpoint, chosen, {none, zero}));
   EXPECT(SYMSDE_WRONG_SHAPE, "2", symsde::simulate(kubo, midpoint, chosen, {two, zero}));
   EXPECT(SYMSDE_WRONG_SHAPE, "dw", symsde::symplecticity(kubo, midpoint, chosen, {one, zero}, two));
   EXPECT(SYMSDE_WRONG_SHAPE, "weights", symsde::scheme(one, two, 1, "mine"));
   EXPECT(SYMSDE_INVALID_ARGUMENT, "take", symsde::compute_moments(kubo, midpoint, chosen, {one, zero}, {1, nullptr}));
   /* declared falsely: refused by name */
   symsde::traits false_trait(1, 1);
   false_trait.additive = 1;
   symsde::functions own;
   own.gradient = [](const symsde::block &at, auto hq, auto hp) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         hq[0][i] = at.w[0][i] * at.q[0][i] + at.w[1][i] * std::sin(at.q[0][i]);
         hp[0][i] = at.w[0][i] * at.p[0][i];
      }
   };
   const symsde::model liar("liar", false_trait, own);
   EXPECT(SYMSDE_FALSE_TRAIT, "additive", symsde::simulate(liar, midpoint, chosen, {one, zero}));
   /* a handle whose contents were moved away */
   symsde::model kept(std::string("kubo"));
   const symsde::model moved(std::move(kept));
   EXPECT(SYMSDE_NULL_HANDLE, "", symsde::simulate(kept, midpoint, chosen, {one, zero}));
   CHECK(symsde::simulate(moved, midpoint, chosen, {one, zero}).status() == SYMSDE_OK);
}

void exceptions() {
   std::atomic<int> calls{0};
   const symsde::scheme by("midpoint");
   const auto chosen = some_options(200, 3000);
   const auto refusing = pendulum(0.4, calls, 1.0);
   CHECK(thrown_number([&] { (void)symsde::simulate(refusing, by, chosen, {half, zero}); }) == 17);
   /* the exception is not kept: a run that ends before the time `refuse` succeeds */
   const auto early = some_options(20, 30);
   CHECK(symsde::simulate(refusing, by, early, {half, zero}).status() == SYMSDE_OK);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "step", symsde::simulate(refusing, by, symsde::options(), {half, zero}));
   CHECK(thrown_number([&] { (void)symsde::compute_moments(refusing, by, chosen, {half, zero}); }) == 17);
   const symsde::observables asked{1, [](double t, auto, auto, auto values) {
                                      if (t > 1) {
                                         throw own_exception{23};
                                      }
                                      for (double &value : values[0]) {
                                         value = t;
                                      }
                                   }};
   const symsde::model kubo("kubo");
   CHECK(thrown_number([&] { (void)symsde::compute_moments(kubo, by, chosen, {half, zero}, asked); }) == 23);
   /* progress is asked at most twenty times a second, so this run takes longer */
   const auto endless = some_options(40000, 3000);
   const symsde::progress broken = [](std::int64_t, std::int64_t) -> bool { throw own_exception{29}; };
   CHECK(thrown_number([&] { (void)symsde::simulate(kubo, by, endless, {half, zero}, broken); }) == 29);
   const auto stopped = symsde::simulate(kubo, by, endless, {half, zero},
                                         [](std::int64_t done, std::int64_t total) { return done < total; });
   CHECK(stopped.status() == SYMSDE_STOPPED && std::isnan(stopped.q(2)[2999]));
   /* failed paths throw no exception: they are NaN, and the status says so */
   auto stormy = some_options(200, 300);
   stormy.step = 1.0;
   symsde::traits declared(1, 1);
   symsde::functions blowing;
   blowing.gradient = [](const symsde::block &at, auto hq, auto hp) {
      for (std::size_t i = 0; i < at.lanes; i++) {
         hq[0][i] = at.w[0][i] * std::pow(at.q[0][i], 3) - at.w[1][i] * std::pow(at.q[0][i], 5);
         hp[0][i] = at.w[0][i] * at.p[0][i];
      }
   };
   const symsde::model blowing_up("blowing up", declared, blowing);
   const auto lost = symsde::simulate(blowing_up, symsde::scheme("euler_maruyama"), stormy, {one, zero});
   CHECK(lost.status() == SYMSDE_PATHS_FAILED && lost.report.failed > 0);
   std::size_t bad = 0;
   while (bad + 1 < 300 && lost.path_status[bad] == 0) {
      bad++;
   }
   CHECK(std::isnan(lost.q(2)[bad]) && lost.failed_step[bad] >= 0);
}

/* Steps in several calls give the bits of one call, and a run outlives its model. */
void prepared() {
   std::atomic<int> calls{0};
   const symsde::scheme by("midpoint");
   const auto chosen = some_options(200, 12);
   auto mine = std::make_unique<symsde::model>(pendulum(0.4, calls));
   const auto whole = symsde::simulate(*mine, by, chosen, {half, zero});
   symsde::run host(*mine, by, chosen, {half, zero});
   mine.reset();
   bool good = true;
   for (int part = 0; part < 20; part++) {
      good = good && host.advance(10) == SYMSDE_OK;
   }
   CHECK(good && host.state().next_step == 200 && host.report().path_steps == 2400);
   bool same = true;
   for (std::size_t i = 0; i < 12; i++) {
      same = same && host.q()[i] == whole.q(2)[i] && host.p()[i] == whole.p(2)[i];
   }
   CHECK(same);
   host.q()[3] = 2.5;
   CHECK(host.q()[3] == 2.5 && host.advance(1) == SYMSDE_OK && host.q()[3] != 2.5);
   symsde::run refusing(pendulum(0.4, calls, 1.0), by, chosen, {half, zero});
   CHECK(thrown_number([&] { (void)refusing.advance(200); }) == 17);
   EXPECT(SYMSDE_INVALID_ARGUMENT, "", host.advance(-1));
}

} // namespace

int main() {
   texts();
   built_in();
   by_path();
   own_model();
   beside_the_catalogue();
   several();
   errors();
   exceptions();
   prepared();
   std::cout << passed << " passed, " << failed << " failed\n";
   return failed > 0;
}
