// CPU budgets for threads of C++ programs: C++17 over replenish.h, header only. Link -lreplenish.
//
//   replenish::Budget control{"control", {30ms, 100ms}};   // throws replenish::Error if it does not fit
//   replenish::Attached here{control};                      // this thread has it until `here` goes
//
// Everything may be used from any thread, as the functions of replenish.h.
#ifndef REPLENISH_HPP
#define REPLENISH_HPP

#include "replenish.h"

#include <chrono>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace replenish {

// A refused or wrong call. what() is the library's sentence, code() one of REPLENISH_INVALID and so on.
class Error : public std::runtime_error {
 public:
  Error(std::int32_t code, const std::string &text) : std::runtime_error(text), code_(code) {}

  std::int32_t code() const noexcept { return code_; }

 private:
  std::int32_t code_;
};

namespace detail {

inline void check(std::int32_t code) {
  if (code != REPLENISH_OK) {
    throw Error(code, replenish_last_error());
  }
}

inline std::uint64_t nanoseconds(std::chrono::nanoseconds time, const char *field) {
  if (time.count() < 0) {
    throw Error(REPLENISH_INVALID, std::string(field) + " is negative");
  }
  return static_cast<std::uint64_t>(time.count());
}

}  // namespace detail

// CPU time in every period: {30ms, 100ms}.
struct Amount {
  std::chrono::nanoseconds time;
  std::chrono::nanoseconds period;
};

// The choices that most budgets do not need.
struct Options {
  // By when the time must have been given; 0: the period.
  std::chrono::nanoseconds deadline{0};
  // A CPU, or REPLENISH_ANY_CPU: the plan chooses.
  std::int32_t cpu = REPLENISH_ANY_CPU;
  // FIFO priority 1 to 98; 0: the plan chooses, and guarantees the amount.
  std::uint32_t priority = 0;
  // REPLENISH_OTHER, REPLENISH_IDLE, or a FIFO priority below the budget's.
  std::int32_t background = REPLENISH_OTHER;
};

// A budget, which threads can have: one, or several that share it. Ends with this object; its threads
// then have what they had before.
class Budget {
 public:
  // Throws Error if it does not fit beside everything that was promised on this host. A [[worker]] of
  // this name in the deployment file (REPLENISH_OVERLAY) overrides amount and options.
  Budget(const std::string &name, Amount amount, const Options &more = Options()) {
    detail::check(make(name, amount, more));
  }

  // The budget that the deployment file has for this name; none if it has none.
  static std::optional<Budget> planned(const std::string &name, const Options &more = Options()) {
    std::optional<Budget> budget(Budget{});
    const std::int32_t code = budget->make(name, {}, more);
    if (code == REPLENISH_NOT_FOUND) {
      return std::nullopt;
    }
    detail::check(code);
    return budget;
  }

  Budget(Budget &&other) noexcept : id_(std::exchange(other.id_, 0)) {}

  Budget &operator=(Budget &&other) noexcept {
    if (this != &other) {
      release();
      id_ = std::exchange(other.id_, 0);
    }
    return *this;
  }

  Budget(const Budget &) = delete;
  Budget &operator=(const Budget &) = delete;

  ~Budget() { release(); }

  // Gives a thread of this process the budget: the calling one, or that of replenish_thread_id().
  void attach(std::int32_t tid = 0) const { detail::check(replenish_budget_attach(id_, tid)); }

  // Gives a thread back what it had.
  void detach(std::int32_t tid = 0) const { detail::check(replenish_budget_detach(id_, tid)); }

  // The figures so far.
  replenish_usage usage() const {
    replenish_usage usage;
    usage.size = sizeof usage;
    detail::check(replenish_budget_usage(id_, &usage));
    return usage;
  }

  // Its number, for the functions of replenish.h. 0 for one that was moved from.
  std::uint64_t id() const noexcept { return id_; }

 private:
  Budget() = default;

  std::int32_t make(const std::string &name, Amount amount, const Options &more) {
    detail::check(replenish_check_version(REPLENISH_VERSION));
    replenish_options options;
    detail::check(replenish_options_init(&options, sizeof options));
    options.name = name.c_str();
    options.amount_ns = detail::nanoseconds(amount.time, "amount");
    options.period_ns = detail::nanoseconds(amount.period, "period");
    options.deadline_ns = detail::nanoseconds(more.deadline, "deadline");
    options.cpu = more.cpu;
    options.priority = more.priority;
    options.background = more.background;
    return replenish_budget_new(&options, &id_);
  }

  void release() noexcept {
    if (id_ != 0) {
      replenish_budget_release(id_);  // fails only where it has ended already
      id_ = 0;
    }
  }

  std::uint64_t id_ = 0;
};

// The thread that makes it has the budget for as long as it lives. Not for another thread's hands.
class Attached {
 public:
  explicit Attached(const Budget &budget) : id_(budget.id()) { budget.attach(); }

  Attached(const Attached &) = delete;
  Attached &operator=(const Attached &) = delete;

  ~Attached() { replenish_budget_detach(id_, 0); }  // fails only where the budget has ended already

 private:
  std::uint64_t id_;
};

// A point of the program in its recording, which `replenish trace` shows. Made before the work begins.
class Mark {
 public:
  explicit Mark(const std::string &name) { detail::check(replenish_mark_new(name.c_str(), &mark_)); }

  // The calling thread has come to it. Lost for a 33rd thread that marks something.
  void operator()(std::uint64_t value = 0) const noexcept { replenish_mark(mark_, value); }

 private:
  std::uint32_t mark_ = 0;
};

// The figures of all budgets of this process. One that ends meanwhile is left out.
inline std::vector<replenish_usage> report() {
  std::size_t count = 0;
  detail::check(replenish_budget_list(nullptr, 0, &count));
  std::vector<std::uint64_t> budgets(count);
  detail::check(replenish_budget_list(budgets.data(), budgets.size(), &count));
  budgets.resize(count < budgets.size() ? count : budgets.size());
  std::vector<replenish_usage> all;
  for (const std::uint64_t budget : budgets) {
    replenish_usage usage;
    usage.size = sizeof usage;
    const std::int32_t code = replenish_budget_usage(budget, &usage);
    if (code == REPLENISH_OK) {
      all.push_back(usage);
    } else if (code != REPLENISH_NOT_FOUND) {
      detail::check(code);
    }
  }
  return all;
}

}  // namespace replenish

#endif  // REPLENISH_HPP
