/* SPDX-License-Identifier: BSD-3-Clause
 *
 * symsde for C++17, its part that symsde.hpp includes: errors, views, models, schemes.
 */
#ifndef SYMSDE_MODELS_HPP
#define SYMSDE_MODELS_HPP

#include "../symsde.h"

#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace symsde {

// ---- errors -----------------------------------------------------------------------------------------

/// What the library refuses: what() is the sentence, code() one of enum symsde_status.
class error : public std::runtime_error {
 public:
   error(int code, const std::string &sentence) : std::runtime_error(sentence), code_(code) {
   }
   [[nodiscard]] int code() const noexcept {
      return code_;
   }

 private:
   int code_;
};

/// Throws unless the status is 0: symsde::check(symsde_model_value(...), failure).
inline void check(int status, const symsde_error &failure) {
   if (status != SYMSDE_OK) {
      throw error(status, failure.message);
   }
}

namespace detail {

/// The text of a function that fills a buffer: fill(buffer, size, needed) -> status.
template <class Fill> std::string text(Fill &&fill) {
   std::size_t needed = 0;
   if (const int status = fill(nullptr, std::size_t{0}, &needed); status != SYMSDE_OK) {
      throw error(status, "symsde: a text is not available");
   }
   std::string found(needed, '\0');
   fill(found.data(), found.size(), &needed);
   found.resize(found.empty() ? 0 : found.size() - 1); // without the terminating zero
   return found;
}

/// A number that is never negative as a size.
inline std::size_t size(std::int64_t count) noexcept {
   return count > 0 ? static_cast<std::size_t>(count) : 0;
}

/// A handle of the C interface with its function that deletes it.
template <class Handle, int (*Delete)(Handle *)> struct deleter {
   void operator()(Handle handle) const noexcept {
      Delete(&handle);
   }
};
template <class Handle, int (*Delete)(Handle *)>
using owner = std::unique_ptr<std::remove_pointer_t<Handle>, deleter<Handle, Delete>>;

/// The first exception of callbacks since the last call of rethrow, kept until the library has returned.
class caught {
 public:
   template <class Call> int guard(Call &&call) noexcept {
      try {
         return call();
      } catch (...) {
         const std::lock_guard<std::mutex> lock(mutex_);
         if (!first_) {
            first_ = std::current_exception();
         }
         return 1;
      }
   }
   void rethrow() {
      std::exception_ptr first;
      {
         const std::lock_guard<std::mutex> lock(mutex_);
         std::swap(first, first_);
      }
      if (first) {
         std::rethrow_exception(first);
      }
   }

 private:
   std::mutex mutex_;
   std::exception_ptr first_;
};

} // namespace detail

inline std::string version() {
   return detail::text(
       [](char *buffer, std::size_t size, std::size_t *needed) { return symsde_version(buffer, size, needed); });
}

inline std::string build_info() {
   return detail::text(
       [](char *buffer, std::size_t size, std::size_t *needed) { return symsde_build_info(buffer, size, needed); });
}

// ---- views ------------------------------------------------------------------------------------------

/// A view of contiguous numbers that it does not own.
template <class T> class span {
 public:
   constexpr span() noexcept = default;
   constexpr span(T *data, std::size_t size) noexcept : data_(data), size_(size) {
   }
   template <std::size_t Size> constexpr span(T (&array)[Size]) noexcept : data_(array), size_(Size) {
   }
   /// a span of a vector, an array or another span; not of a temporary, whose numbers would be gone
   template <class Container,
             class = std::enable_if_t<std::is_convertible_v<decltype(std::declval<Container &>().data()), T *>>>
   constexpr span(Container &container) noexcept : data_(container.data()), size_(container.size()) {
   }
   constexpr T &operator[](std::size_t index) const noexcept {
      return data_[index];
   }
   constexpr T *data() const noexcept {
      return data_;
   }
   constexpr std::size_t size() const noexcept {
      return size_;
   }
   constexpr T *begin() const noexcept {
      return data_;
   }
   constexpr T *end() const noexcept {
      return data_ + size_;
   }

 private:
   T *data_ = nullptr;
   std::size_t size_ = 0;
};

/// Rows of equal length: rows[i] is a span; rows(i, j) is row i * columns + j, as in hqp(j, i).
template <class T> class rows {
 public:
   rows(T *data, std::size_t columns, std::size_t length) noexcept : data_(data), columns_(columns), length_(length) {
   }
   span<T> operator[](std::size_t row) const noexcept {
      return {data_ + row * length_, length_};
   }
   span<T> operator()(std::size_t row, std::size_t column) const noexcept {
      return (*this)[row * columns_ + column];
   }

 private:
   T *data_;
   std::size_t columns_, length_;
};

/// Where a function of a model is evaluated: a block of lanes, each a path.
struct block {
   std::size_t lanes, ndof, nham; ///< nham: the Hamiltonian and the noises' H_1 .. H_m
   double t;
   rows<const double> w, q, p; ///< w[nham][lanes], weights of the Hamiltonians; q and p[ndof][lanes]
};

// ---- structs with their defaults --------------------------------------------------------------------

struct traits : symsde_traits {
   explicit traits(int dof = 1, int noises = 1) : symsde_traits{} {
      symsde_traits_init(this);
      ndof = dof;
      nnoise = noises;
   }
};

struct options : symsde_options {
   options() : symsde_options{} {
      symsde_options_init(this);
   }
};

// ---- models -----------------------------------------------------------------------------------------

/// The functions of your own model: sums over j of w[j] H_j and derivatives. All but gradient may be left empty.
struct functions {
   std::function<void(const block &, rows<double> hq, rows<double> hp)> gradient;
   std::function<void(const block &, span<double> value)> value;
   /// hqp(j, i) = d2/(dq_i dp_j)
   std::function<void(const block &, rows<double> hqq, rows<double> hqp, rows<double> hpp)> hessian;
   /// the Hessian times (vq, vp)
   std::function<void(const block &, rows<const double> vq, rows<const double> vp, rows<double> uq, rows<double> up)>
       hessian_vector;
};

class model {
 public:
   using parameters = std::vector<std::pair<std::string, double>>;
   /// numbers of each parameter for all paths [paths], or [1]; with row_paths = n of the options [paths / n]
   using parameters_by_path = std::vector<std::pair<std::string, span<const double>>>;

   /// a built-in model; parameters that are not given keep their defaults
   explicit model(const std::string &name, const parameters &given = {}) {
      std::vector<const char *> keys;
      std::vector<double> values;
      for (const auto &[key, value] : given) {
         keys.push_back(key.c_str());
         values.push_back(value);
      }
      symsde_model handle = nullptr;
      symsde_error failure;
      check(
          symsde_model_get(name.c_str(), static_cast<int>(keys.size()), keys.data(), values.data(), &handle, &failure),
          failure);
      handle_.reset(handle);
   }

   /// a built-in model with parameters that differ from path to path, as many numbers of each; they are copied
   [[nodiscard]] static model by_path(const std::string &name, const parameters_by_path &given) {
      const std::size_t rows = given.empty() ? 1 : given.front().second.size();
      std::vector<const char *> keys;
      std::vector<double> values;
      for (const auto &[key, numbers] : given) {
         if (numbers.size() != rows) {
            throw error(SYMSDE_WRONG_SHAPE, "parameter " + key + " of model '" + name + "' has " +
                                                std::to_string(numbers.size()) + " numbers, and " +
                                                given.front().first + " has " + std::to_string(rows) +
                                                ": give as many of each, one for each path or one for all");
         }
         keys.push_back(key.c_str());
         values.insert(values.end(), numbers.begin(), numbers.end());
      }
      model made;
      symsde_model handle = nullptr;
      symsde_error failure;
      check(symsde_model_get_by_path(name.c_str(), static_cast<int>(keys.size()), keys.data(),
                                     static_cast<std::int64_t>(rows), values.data(), &handle, &failure),
            failure);
      made.handle_.reset(handle);
      return made;
   }

   /// your own model
   model(const std::string &name, const traits &declared, functions given)
       : own_(std::make_shared<own>(std::move(given))) {
      if (!own_->given.gradient) {
         throw error(SYMSDE_INVALID_ARGUMENT, "the model '" + name + "' has no gradient: give functions.gradient");
      }
      symsde_model handle = nullptr;
      symsde_error failure;
      check(symsde_model_new(name.c_str(), &declared, gradient, own_->given.value ? value : nullptr,
                             own_->given.hessian ? hessian : nullptr,
                             own_->given.hessian_vector ? hessian_vector : nullptr, own_.get(), &handle, &failure),
            failure);
      handle_.reset(handle);
   }

   [[nodiscard]] symsde_model get() const noexcept {
      return handle_.get();
   }
   [[nodiscard]] traits declared() const {
      traits found;
      symsde_error failure;
      check(symsde_model_traits(get(), &found, &failure), failure);
      return found;
   }
   /// after a call that may have called this model's functions: throws their exception, or the library's error
   void check_call(int status, const symsde_error &failure) const {
      calls{own_}.check_call(status, failure);
   }

   /// names of the built-in models, one a line
   [[nodiscard]] static std::string names() {
      return detail::text(
          [](char *buffer, std::size_t size, std::size_t *needed) { return symsde_model_names(buffer, size, needed); });
   }

 private:
   model() = default;

   struct own {
      explicit own(functions &&functions_given) : given(std::move(functions_given)) {
      }
      functions given;
      detail::caught thrown;
   };

   static block at(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p) {
      const auto lanes = detail::size(nlane), dof = detail::size(ndof), ham = detail::size(nham);
      return {lanes, dof, ham, t, {w, 1, lanes}, {q, 1, lanes}, {p, 1, lanes}};
   }
   template <class Call> static int guarded(void *user, Call &&call) {
      auto &self = *static_cast<own *>(user);
      return self.thrown.guard([&] {
         call(self.given);
         return 0;
      });
   }
   static int gradient(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                       double *hq, double *hp, void *user) {
      return guarded(user, [&](const functions &given) {
         const block here = at(nlane, ndof, nham, t, w, q, p);
         given.gradient(here, {hq, 1, here.lanes}, {hp, 1, here.lanes});
      });
   }
   static int value(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                    double *value, void *user) {
      return guarded(user, [&](const functions &given) {
         const block here = at(nlane, ndof, nham, t, w, q, p);
         given.value(here, {value, here.lanes});
      });
   }
   static int hessian(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                      double *hqq, double *hqp, double *hpp, void *user) {
      return guarded(user, [&](const functions &given) {
         const block here = at(nlane, ndof, nham, t, w, q, p);
         given.hessian(here, {hqq, here.ndof, here.lanes}, {hqp, here.ndof, here.lanes}, {hpp, here.ndof, here.lanes});
      });
   }
   static int hessian_vector(int nlane, int ndof, int nham, double t, const double *w, const double *q, const double *p,
                             const double *vq, const double *vp, double *uq, double *up, void *user) {
      return guarded(user, [&](const functions &given) {
         const block here = at(nlane, ndof, nham, t, w, q, p);
         given.hessian_vector(here, {vq, 1, here.lanes}, {vp, 1, here.lanes}, {uq, 1, here.lanes}, {up, 1, here.lanes});
      });
   }

   /// The user's functions, which a prepared run keeps beyond the life of the model.
   struct calls {
      std::shared_ptr<own> kept;
      void check_call(int status, const symsde_error &failure) const {
         if (kept && status != SYMSDE_OK) {
            kept->thrown.rethrow();
         }
         check(status, failure);
      }
   };
   friend class run;

   std::shared_ptr<own> own_; // declared before the handle, which is deleted first
   detail::owner<symsde_model, symsde_model_delete> handle_;
};

// ---- schemes ----------------------------------------------------------------------------------------

class scheme {
 public:
   /// a scheme of the catalogue
   explicit scheme(const std::string &name) {
      make([&](symsde_scheme *handle, symsde_error *failure) {
         return symsde_scheme_get(name.c_str(), handle, failure);
      });
   }
   /// the scheme of a quadrature of the action: nodes and as many weights, polynomials of this degree
   scheme(span<const double> nodes, span<const double> weights, int degree, const std::string &name) {
      if (nodes.size() != weights.size()) {
         throw error(SYMSDE_WRONG_SHAPE, "the quadrature '" + name + "' has " + std::to_string(nodes.size()) +
                                             " nodes and " + std::to_string(weights.size()) +
                                             " weights: give as many of both");
      }
      make([&](symsde_scheme *handle, symsde_error *failure) {
         return symsde_scheme_from_quadrature(static_cast<int>(nodes.size()), nodes.data(), weights.data(), nullptr,
                                              degree, name.c_str(), handle, failure);
      });
   }
   /// a handle made by symsde.h, which is deleted with this object
   explicit scheme(symsde_scheme handle) noexcept : handle_(handle) {
   }

   [[nodiscard]] symsde_scheme get() const noexcept {
      return handle_.get();
   }
   [[nodiscard]] symsde_scheme_info info() const {
      symsde_scheme_info found;
      symsde_error failure;
      symsde_scheme_info_init(&found);
      check(symsde_scheme_get_info(get(), &found, &failure), failure);
      return found;
   }
   [[nodiscard]] std::string certificate() const {
      return detail::text([this](char *buffer, std::size_t size, std::size_t *needed) {
         return symsde_scheme_certificate(get(), buffer, size, needed, nullptr);
      });
   }
   [[nodiscard]] static std::string names() {
      return detail::text([](char *buffer, std::size_t size, std::size_t *needed) {
         return symsde_scheme_names(buffer, size, needed);
      });
   }

 private:
   template <class Make> void make(Make &&made) {
      symsde_scheme handle = nullptr;
      symsde_error failure;
      check(made(&handle, &failure), failure);
      handle_.reset(handle);
   }
   detail::owner<symsde_scheme, symsde_scheme_delete> handle_;
};

} // namespace symsde

#endif
