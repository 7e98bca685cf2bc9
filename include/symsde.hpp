/* SPDX-License-Identifier: BSD-3-Clause
 *
 * symsde for C++17: a thin layer over symsde.h, headers alone.
 *
 * - Handles free themselves. They are moved, not copied. What is not wrapped here is called with handle.get().
 * - Functions of a model, observables and progress are lambdas with captures, or anything else that can be called. The
 *   functions of a model are called from several threads at once unless options.threads = 1. If one throws, the run
 *   ends and the exception arrives at the caller.
 * - What the library refuses is thrown as symsde::error, with its sentence and code. If paths fail or progress stops a
 *   run, nothing is thrown: status() says so, and the compiler warns if you ignore it.
 * - Structs are those of symsde.h, already filled with their defaults. Results own their arrays and hand out spans.
 */
#ifndef SYMSDE_HPP
#define SYMSDE_HPP

#include "symsde/models.hpp"

#include <initializer_list>
#include <new>

namespace symsde {

// ---- runs -------------------------------------------------------------------------------------------

/// Called with the work done and the total work; returning true stops the run.
using progress = std::function<bool(std::int64_t done, std::int64_t total)>;

/// q and p [ndof] for all paths, or [ndof][paths]: views of the caller's numbers, which must live as long as the call.
struct start {
   span<const double> q, p;
};

namespace detail {

/// The input of a run, which keeps exceptions of progress. It is never moved, since the library holds its address.
class input : public symsde_input {
 public:
   input(const model &from, const start &given, const symsde::progress &told) : symsde_input{}, told_(told) {
      symsde_input_init(this);
      const auto ndof = static_cast<std::size_t>(from.declared().ndof);
      q0 = given.q.data();
      p0 = given.p.data();
      q0_paths = columns(given.q.size(), ndof, "q");
      p0_paths = columns(given.p.size(), ndof, "p");
      progress_user = this;
      symsde_input::progress = told_ ? &input::tell : nullptr;
   }
   input(const input &) = delete;
   input &operator=(const input &) = delete;

   caught thrown;

 private:
   static std::int64_t columns(std::size_t size, std::size_t ndof, const char *name) {
      if (size == 0 || size % ndof != 0) {
         throw error(SYMSDE_WRONG_SHAPE, std::string("the start has ") + std::to_string(size) + " numbers for " + name +
                                             ": give " + std::to_string(ndof) + ", or as many for each path");
      }
      return static_cast<std::int64_t>(size / ndof);
   }
   static int tell(std::int64_t done, std::int64_t total, void *user) {
      auto &self = *static_cast<input *>(user);
      return self.thrown.guard([&] { return self.told_(done, total) ? 1 : 0; });
   }
   const symsde::progress &told_;
};

/// Runs whose paths failed, or that were stopped, have results; everything else is thrown.
inline bool has_results(int status) noexcept {
   return status == SYMSDE_OK || status == SYMSDE_PATHS_FAILED || status == SYMSDE_STOPPED;
}

inline void check_run(int status, const symsde_error &failure, const model &from, input &given) {
   given.thrown.rethrow();
   if (!has_results(status)) {
      from.check_call(status, failure);
   }
}

/// The number of saved times; 1 if the options are invalid, which the library then refuses.
inline std::size_t times(const symsde_options &chosen) noexcept {
   return chosen.save_every > 0 ? size(chosen.steps / chosen.save_every) + 1 : 1;
}

/// Allocate room for the results of a run, or throw an error. Sizes whose product overflows are too large in any case.
template <class T> void reserve(std::vector<T> &room, std::initializer_list<std::size_t> extents, T value = T()) {
   std::size_t total = 1;
   try {
      for (const std::size_t extent : extents) {
         if (extent != 0 && total > room.max_size() / extent) {
            throw std::bad_alloc();
         }
         total *= extent;
      }
      room.assign(total, value);
   } catch (const std::bad_alloc &) {
      throw error(SYMSDE_OUT_OF_MEMORY, "the results of this run do not fit into memory: "
                                        "save fewer times or paths, or ask for moments");
   }
}

} // namespace detail

/// Saved paths: q(time, i) and p(time, i) are spans over paths; values after a failure are NaN.
class paths {
 public:
   std::vector<double> t;
   std::vector<std::int32_t> path_status;  ///< [paths] 0, or the status of a path that failed
   std::vector<std::int64_t> failed_step;  ///< [paths] -1: none
   symsde_report report{};

   /// SYMSDE_OK, SYMSDE_PATHS_FAILED or SYMSDE_STOPPED
   [[nodiscard]] int status() const noexcept {
      return report.status;
   }
   [[nodiscard]] span<const double> q(std::size_t time, std::size_t i = 0) const noexcept {
      return {q_.data() + (time * ndof_ + i) * path_status.size(), path_status.size()};
   }
   [[nodiscard]] span<const double> p(std::size_t time, std::size_t i = 0) const noexcept {
      return {p_.data() + (time * ndof_ + i) * path_status.size(), path_status.size()};
   }

 private:
   std::size_t ndof_ = 1;
   std::vector<double> q_, p_;
   friend paths simulate(const model &, const scheme &, const options &, const start &, const progress &);
};

[[nodiscard]] inline paths simulate(const model &from, const scheme &by, const options &chosen, const start &begin,
                                    const progress &told = {}) {
   detail::input given(from, begin, told);
   const std::size_t ntime = detail::times(chosen), npath = detail::size(chosen.paths);
   paths found;
   found.ndof_ = static_cast<std::size_t>(from.declared().ndof);
   detail::reserve(found.t, {ntime});
   detail::reserve(found.q_, {ntime, found.ndof_, npath});
   detail::reserve(found.p_, {ntime, found.ndof_, npath});
   detail::reserve(found.path_status, {npath});
   detail::reserve(found.failed_step, {npath});
   symsde_paths arrays;
   symsde_paths_init(&arrays);
   arrays.t = found.t.data();
   arrays.q = found.q_.data();
   arrays.p = found.p_.data();
   arrays.status = found.path_status.data();
   arrays.failed_step = found.failed_step.data();
   symsde_report_init(&found.report);
   symsde_error failure;
   const int status = symsde_simulate(from.get(), by.get(), &chosen, &given, &arrays, &found.report, &failure);
   detail::check_run(status, failure, from, given);
   return found;
}

/// Your own observables: values[i] is a span over the lanes of q and p.
struct observables {
   std::size_t count = 0;
   std::function<void(double t, rows<const double> q, rows<const double> p, rows<double> values)> take;
};

/// Means over the paths that are ok up to each time, of q_1 .. q_n, p_1 .. p_n, the energy where the model has a value,
/// and the observables: mean(time)[value].
class moments {
 public:
   std::vector<double> t;
   std::vector<std::int64_t> n_ok;
   std::size_t values = 0; ///< number of values at each time
   symsde_report report{};

   /// SYMSDE_OK, SYMSDE_PATHS_FAILED or SYMSDE_STOPPED
   [[nodiscard]] int status() const noexcept {
      return report.status;
   }
   [[nodiscard]] span<const double> mean(std::size_t time) const noexcept {
      return {mean_.data() + time * values, values};
   }
   [[nodiscard]] span<const double> variance(std::size_t time) const noexcept {
      return {variance_.data() + time * values, values};
   }
   [[nodiscard]] span<const double> se_mean(std::size_t time) const noexcept {
      return {se_mean_.data() + time * values, values};
   }

 private:
   std::vector<double> mean_, variance_, se_mean_;
   friend moments compute_moments(const model &, const scheme &, const options &, const start &, const observables &,
                                  const progress &);
};

namespace detail {

struct observing {
   const observables &asked;
   caught thrown;

   static int take(int nlane, int ndof, double t, const double *q, const double *p, double *values, void *user) {
      (void)ndof;
      auto &self = *static_cast<observing *>(user);
      const std::size_t lanes = size(nlane);
      return self.thrown.guard([&] {
         self.asked.take(t, {q, 1, lanes}, {p, 1, lanes}, {values, 1, lanes});
         return 0;
      });
   }
};

} // namespace detail

[[nodiscard]] inline moments compute_moments(const model &from, const scheme &by, const options &chosen,
                                             const start &begin, const observables &asked = {},
                                             const progress &told = {}) {
   if (asked.count > 0 && !asked.take) {
      throw error(SYMSDE_INVALID_ARGUMENT, std::to_string(asked.count) + " observables without a function: give take");
   }
   detail::input given(from, begin, told);
   detail::observing observer{asked, {}};
   const traits of = from.declared();
   const std::size_t ntime = detail::times(chosen);
   moments found;
   found.values = 2 * detail::size(of.ndof) + (of.has_value != 0 ? 1 : 0) + asked.count;
   detail::reserve(found.t, {ntime});
   detail::reserve(found.n_ok, {ntime});
   for (auto *room : {&found.mean_, &found.variance_, &found.se_mean_}) {
      detail::reserve(*room, {ntime, found.values});
   }
   const auto arrays = std::make_unique<symsde_moments>(); // 20 kB
   symsde_moments_init(arrays.get());
   arrays->t = found.t.data();
   arrays->n_ok = found.n_ok.data();
   arrays->mean = found.mean_.data();
   arrays->variance = found.variance_.data();
   arrays->se_mean = found.se_mean_.data();
   arrays->nobservable = static_cast<std::int32_t>(asked.count);
   arrays->observables = asked.count > 0 ? detail::observing::take : nullptr;
   arrays->observables_user = &observer;
   symsde_report_init(&found.report);
   symsde_error failure;
   const int status =
       symsde_compute_moments(from.get(), by.get(), &chosen, &given, arrays.get(), &found.report, &failure);
   observer.thrown.rethrow();
   detail::check_run(status, failure, from, given);
   return found;
}

/// A prepared run: checks and allocations once, then as many steps as wanted, in as many calls.
class run {
 public:
   run(const model &from, const scheme &by, const options &chosen, const start &begin) : from_{from.own_} {
      const progress silent;
      const detail::input given(from, begin, silent);
      symsde_run handle = nullptr;
      symsde_error failure;
      from_.check_call(symsde_run_new(from.get(), by.get(), &chosen, &given, &handle, &failure), failure);
      handle_.reset(handle);
   }

   /// take further steps; SYMSDE_OK, or SYMSDE_PATHS_FAILED if some paths are not ok, also from an earlier call
   [[nodiscard]] int advance(std::int64_t steps) {
      symsde_error failure;
      const int status = symsde_run_advance(get(), steps, 1, nullptr, nullptr, &failure);
      if (!detail::has_results(status)) {
         from_.check_call(status, failure);
      }
      return status;
   }
   [[nodiscard]] symsde_run get() const noexcept {
      return handle_.get();
   }
   /// the state; between calls q and p may be changed
   [[nodiscard]] symsde_state state() const {
      symsde_state found;
      symsde_error failure;
      symsde_state_init(&found);
      check(symsde_run_state(get(), &found, &failure), failure);
      return found;
   }
   [[nodiscard]] span<double> q(std::size_t i = 0) {
      const symsde_state now = state();
      return {now.q + i * detail::size(now.paths), detail::size(now.paths)};
   }
   [[nodiscard]] span<double> p(std::size_t i = 0) {
      const symsde_state now = state();
      return {now.p + i * detail::size(now.paths), detail::size(now.paths)};
   }
   [[nodiscard]] symsde_report report() const {
      symsde_report found;
      symsde_error failure;
      symsde_report_init(&found);
      check(symsde_run_report(get(), &found, &failure), failure);
      return found;
   }

 private:
   model::calls from_; // declared before the handle, which is deleted first
   detail::owner<symsde_run, symsde_run_delete> handle_;
};

// ---- diagnostics ------------------------------------------------------------------------------------

/// the increments that drive a run of this scheme: [steps][nnoise][paths]
[[nodiscard]] inline std::vector<double> increments(const model &from, const scheme &by, const options &chosen) {
   std::vector<double> found;
   detail::reserve(found,
                   {detail::size(chosen.steps), detail::size(from.declared().nnoise), detail::size(chosen.paths)});
   symsde_error failure;
   check(symsde_increments(from.get(), by.get(), &chosen, found.data(), &failure), failure);
   return found;
}

/// max |M^T J M - J| of the tangent map M of one step from q, p [ndof][points] with increments dw [nnoise][points]
[[nodiscard]] inline std::vector<double> symplecticity(const model &from, const scheme &by, const options &chosen,
                                                       const start &at, span<const double> dw) {
   const traits of = from.declared();
   const std::size_t points = at.q.size() / detail::size(of.ndof);
   if (points == 0 || at.q.size() != points * detail::size(of.ndof) || at.p.size() != at.q.size() ||
       dw.size() != points * detail::size(of.nnoise)) {
      throw error(SYMSDE_WRONG_SHAPE, "symplecticity takes q and p [" + std::to_string(of.ndof) + "][points] and dw [" +
                                          std::to_string(of.nnoise) + "][points]; given are " +
                                          std::to_string(at.q.size()) + ", " + std::to_string(at.p.size()) + " and " +
                                          std::to_string(dw.size()) + " numbers");
   }
   std::vector<double> found(points);
   symsde_error failure;
   from.check_call(symsde_symplecticity(from.get(), by.get(), &chosen, static_cast<std::int64_t>(points), at.q.data(),
                                        at.p.data(), dw.data(), found.data(), &failure),
                   failure);
   return found;
}

} // namespace symsde

#endif
