// Budgets for rclcpp: an executor that gives each callback group a thread with its budget. Header only,
// so that it is compiled with the rclcpp of its user. C++17.
//
//   auto control = node->create_callback_group(rclcpp::CallbackGroupType::MutuallyExclusive, false);
//   replenish::Executor exec;
//   exec.add_callback_group(control, node, {30ms, 100ms});   // throws replenish::Error if it does not fit
//   exec.add_node(node);                                     // all other groups: an ordinary thread
//   exec.spin();
//
// A group must be made with `false`, as above: otherwise add_node takes it, too, and rclcpp throws.
#ifndef REPLENISH_RCLCPP_HPP
#define REPLENISH_RCLCPP_HPP

#include "replenish.hpp"

#include <rclcpp/rclcpp.hpp>

#include <chrono>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace replenish {

// Threads with budgets, one for each callback group. Set up and spun by one thread; cancel() and usage()
// may be called from any.
class Executor {
 public:
  using Node = ::rclcpp::node_interfaces::NodeBaseInterface::SharedPtr;

  explicit Executor(::rclcpp::ExecutorOptions options = ::rclcpp::ExecutorOptions())
      : options_(std::move(options)) {}

  Executor(const Executor &) = delete;
  Executor &operator=(const Executor &) = delete;

  // Gives the group a budget and, in spin(), a thread. The name is for reports and the deployment file
  // (REPLENISH_OVERLAY); default: group-0 and so on. Throws Error if the budget does not fit, and then the
  // group is not added.
  void add_callback_group(::rclcpp::CallbackGroup::SharedPtr group, Node node, Amount amount,
                          const Options &more = Options(), const std::string &name = "") {
    const std::string number = "group-" + std::to_string(threads_.size());
    add_group(std::move(group), std::move(node), Budget(name.empty() ? number : name, amount, more));
  }

  // Gives the group a thread, with the budget that the deployment file has for its name, if it has one.
  void add_callback_group(::rclcpp::CallbackGroup::SharedPtr group, Node node,
                          const std::string &name, const Options &more = Options()) {
    add_group(std::move(group), std::move(node), Budget::planned(name, more));
  }

  template <typename NodeT>
  auto add_callback_group(::rclcpp::CallbackGroup::SharedPtr group,
                          const std::shared_ptr<NodeT> &node, const std::string &name,
                          const Options &more = Options())
      -> decltype(node->get_node_base_interface(), void()) {
    add_callback_group(std::move(group), node->get_node_base_interface(), name, more);
  }

  // The same for rclcpp::Node, rclcpp_lifecycle::LifecycleNode and the like.
  template <typename NodeT>
  auto add_callback_group(::rclcpp::CallbackGroup::SharedPtr group,
                          const std::shared_ptr<NodeT> &node, Amount amount,
                          const Options &more = Options(), const std::string &name = "")
      -> decltype(node->get_node_base_interface(), void()) {
    add_callback_group(std::move(group), node->get_node_base_interface(), amount, more, name);
  }

  // The node's groups that are added to executors by themselves: one ordinary thread for all nodes.
  void add_node(Node node) {
    if (rest_ == nullptr) {
      auto thread = std::make_unique<Thread>(options_);
      auto *executor = &thread->executor;
      add(std::move(thread));
      rest_ = executor;
    }
    rest_->add_node(std::move(node));
  }

  template <typename NodeT>
  auto add_node(const std::shared_ptr<NodeT> &node)
      -> decltype(node->get_node_base_interface(), void()) {
    add_node(node->get_node_base_interface());
  }

  // Runs every group on its thread until cancel() or the shutdown of rclcpp. Throws the first exception
  // of a callback, and Error if a thread does not get its budget; all threads have ended then.
  void spin() {
    std::unique_lock<std::mutex> lock(mutex_);
    if (running_) {
      throw std::runtime_error("replenish::Executor::spin is running already");
    }
    running_ = true;
    failure_ = nullptr;
    for (auto &thread : threads_) {
      thread->ended = false;
      try {
        thread->thread = std::thread([this, one = thread.get()] { run(*one); });
      } catch (...) {
        failure_ = std::current_exception();
        thread->ended = true;
        stop_ = true;
      }
    }
    // One that ends by itself ends all: rclcpp was shut down, or a callback threw.
    changed_.wait(lock, [this] { return stop_ || any_ended(); });
    stop_ = true;
    for (auto &thread : threads_) {
      // rclcpp loses a cancel() that comes before spin(): it is repeated until it is heard.
      while (!thread->ended) {
        lock.unlock();
        thread->executor.cancel();
        lock.lock();
        changed_.wait_for(lock, std::chrono::milliseconds(10),
                          [one = thread.get()] { return one->ended; });
      }
      if (thread->thread.joinable()) {
        lock.unlock();
        thread->thread.join();
        lock.lock();
      }
    }
    running_ = false;
    stop_ = false;
    const std::exception_ptr failure = std::exchange(failure_, nullptr);
    lock.unlock();
    if (failure) {
      std::rethrow_exception(failure);
    }
  }

  // Ends spin(), or the next one if none is running.
  void cancel() {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
    changed_.notify_all();
  }

  // The figures of each group's budget, in the order in which the groups were added.
  std::vector<replenish_usage> usage() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::vector<replenish_usage> all;
    for (const auto &thread : threads_) {
      if (thread->budget) {
        all.push_back(thread->budget->usage());
      }
    }
    return all;
  }

 private:
  struct Thread {
    explicit Thread(const ::rclcpp::ExecutorOptions &options) : executor(options) {}

    ::rclcpp::executors::SingleThreadedExecutor executor;
    std::optional<Budget> budget;
    std::thread thread;
    bool ended = true;
  };

  void add_group(::rclcpp::CallbackGroup::SharedPtr group, Node node,
                 std::optional<Budget> budget) {
    auto thread = std::make_unique<Thread>(options_);
    thread->budget = std::move(budget);
    thread->executor.add_callback_group(std::move(group), std::move(node));
    add(std::move(thread));
  }

  void add(std::unique_ptr<Thread> thread) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (running_) {
      throw std::runtime_error("replenish::Executor: groups and nodes are added before spin");
    }
    threads_.push_back(std::move(thread));
  }

  void run(Thread &one) {
    std::exception_ptr failure;
    try {
      std::optional<Attached> attached;
      if (one.budget) {
        attached.emplace(*one.budget);
      }
      one.executor.spin();
    } catch (...) {
      failure = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    one.ended = true;
    if (failure && !failure_) {
      failure_ = failure;
    }
    changed_.notify_all();
  }

  bool any_ended() const {
    for (const auto &thread : threads_) {
      if (thread->ended) {
        return true;
      }
    }
    return false;
  }

  ::rclcpp::ExecutorOptions options_;
  std::vector<std::unique_ptr<Thread>> threads_;
  ::rclcpp::executors::SingleThreadedExecutor *rest_ = nullptr;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::exception_ptr failure_;
  bool running_ = false;
  bool stop_ = false;
};

}  // namespace replenish

#endif  // REPLENISH_RCLCPP_HPP
