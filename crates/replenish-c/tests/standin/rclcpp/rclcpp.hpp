// A stand-in for rclcpp, which cannot be had from Debian's or Python's package index: the signatures of
// what replenish_rclcpp.hpp and its example use, as in rclcpp's executor.hpp, node.hpp and
// callback_group.hpp of Humble to Rolling, over timers alone. For tests.
#ifndef STANDIN_RCLCPP_HPP
#define STANDIN_RCLCPP_HPP

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace rclcpp {

inline std::atomic<bool> &standin_ok() {
  static std::atomic<bool> ok{false};
  return ok;
}

inline void init(int, char const *const *) { standin_ok() = true; }
inline bool shutdown() { return standin_ok().exchange(false); }
inline bool ok() { return standin_ok(); }

enum class CallbackGroupType { MutuallyExclusive, Reentrant };

class TimerBase {
 public:
  using SharedPtr = std::shared_ptr<TimerBase>;

  TimerBase(std::chrono::nanoseconds period, std::function<void()> callback)
      : period_(period), next_(std::chrono::steady_clock::now() + period),
        callback_(std::move(callback)) {}

  bool run_if_due() {
    const auto now = std::chrono::steady_clock::now();
    if (now < next_) {
      return false;
    }
    next_ = std::max(next_ + period_, now);
    callback_();
    return true;
  }

 private:
  std::chrono::nanoseconds period_;
  std::chrono::steady_clock::time_point next_;
  std::function<void()> callback_;
};

class CallbackGroup {
 public:
  using SharedPtr = std::shared_ptr<CallbackGroup>;

  CallbackGroup(CallbackGroupType, bool is_automatic) : automatic(is_automatic) {}

  std::atomic_bool &get_associated_with_executor_atomic() { return taken_; }

  std::vector<TimerBase::SharedPtr> timers;
  const bool automatic;

 private:
  std::atomic_bool taken_{false};
};

namespace node_interfaces {

class NodeBaseInterface {
 public:
  using SharedPtr = std::shared_ptr<NodeBaseInterface>;

  std::vector<CallbackGroup::SharedPtr> groups;
};

}  // namespace node_interfaces

class Node {
 public:
  using SharedPtr = std::shared_ptr<Node>;

  explicit Node(const std::string &) {
    fallback_ = create_callback_group(CallbackGroupType::MutuallyExclusive);
  }

  CallbackGroup::SharedPtr create_callback_group(
      CallbackGroupType type, bool automatically_add_to_executor_with_node = true) {
    auto group = std::make_shared<CallbackGroup>(type, automatically_add_to_executor_with_node);
    base_->groups.push_back(group);
    return group;
  }

  template <typename DurationRepT, typename DurationT, typename CallbackT>
  TimerBase::SharedPtr create_wall_timer(std::chrono::duration<DurationRepT, DurationT> period,
                                         CallbackT callback,
                                         CallbackGroup::SharedPtr group = nullptr) {
    auto timer = std::make_shared<TimerBase>(period, std::move(callback));
    (group ? group : fallback_)->timers.push_back(timer);
    return timer;
  }

  node_interfaces::NodeBaseInterface::SharedPtr get_node_base_interface() { return base_; }

 private:
  node_interfaces::NodeBaseInterface::SharedPtr base_ =
      std::make_shared<node_interfaces::NodeBaseInterface>();
  CallbackGroup::SharedPtr fallback_;
};

struct ExecutorOptions {};

class Executor {
 public:
  explicit Executor(const ExecutorOptions & = ExecutorOptions()) {}
  Executor(const Executor &) = delete;
  Executor &operator=(const Executor &) = delete;
  virtual ~Executor() = default;

  virtual void spin() = 0;

  virtual void add_callback_group(CallbackGroup::SharedPtr group_ptr,
                                  node_interfaces::NodeBaseInterface::SharedPtr, bool = true) {
    if (group_ptr->get_associated_with_executor_atomic().exchange(true)) {
      throw std::runtime_error("Callback group has already been added to an executor.");
    }
    groups_.push_back(std::move(group_ptr));
  }

  virtual void add_node(node_interfaces::NodeBaseInterface::SharedPtr node_ptr,
                        bool notify = true) {
    for (const auto &group : node_ptr->groups) {
      if (group->automatic) {
        add_callback_group(group, node_ptr, notify);
      }
    }
  }

  virtual void add_node(std::shared_ptr<Node> node_ptr, bool notify = true) {
    add_node(node_ptr->get_node_base_interface(), notify);
  }

  // As in rclcpp: without effect before spin().
  virtual void cancel() { spinning = false; }

 protected:
  std::vector<CallbackGroup::SharedPtr> groups_;
  std::atomic_bool spinning{false};
};

namespace executors {

class SingleThreadedExecutor : public Executor {
 public:
  explicit SingleThreadedExecutor(const ExecutorOptions &options = ExecutorOptions())
      : Executor(options) {}

  void spin() override {
    if (spinning.exchange(true)) {
      throw std::runtime_error("spin() called while already spinning");
    }
    // As in rclcpp, also when a callback throws.
    struct End {
      std::atomic_bool &spinning;
      ~End() { spinning = false; }
    } end{spinning};
    while (ok() && spinning) {
      bool worked = false;
      for (const auto &group : groups_) {
        for (const auto &timer : group->timers) {
          worked = timer->run_if_due() || worked;
        }
      }
      if (!worked) {
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
    }
  }
};

}  // namespace executors
}  // namespace rclcpp

#endif  // STANDIN_RCLCPP_HPP
