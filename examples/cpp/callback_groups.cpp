// rclcpp: two callback groups of one node, each with a thread and a budget of its own, and a timer in
// the node's default group without one.
//
//     callback_groups [SECONDS [CPU]]
#include <rclcpp/rclcpp.hpp>
#include <replenish_rclcpp.hpp>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <memory>

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

namespace {

void burn(Clock::duration time) {
  const auto end = Clock::now() + time;
  while (Clock::now() < end) {
  }
}

int run(Clock::duration time, std::int32_t cpu) {
  auto node = std::make_shared<rclcpp::Node>("groups");
  const auto kind = rclcpp::CallbackGroupType::MutuallyExclusive;
  auto control = node->create_callback_group(kind, false);
  auto planner = node->create_callback_group(kind, false);

  replenish::Options more;
  more.cpu = cpu;
  replenish::Executor exec;
  exec.add_callback_group(control, node, {10ms, 50ms}, more, "control");
  exec.add_callback_group(planner, node, {20ms, 100ms}, more, "planner");
  exec.add_node(node);

  int rounds = 0;
  const auto a = node->create_wall_timer(1ms, [&] { ++rounds, burn(1ms); }, control);
  const auto b = node->create_wall_timer(1ms, [] { burn(50ms); }, planner);
  const auto begin = Clock::now();
  const auto end = node->create_wall_timer(10ms, [&] {
    if (Clock::now() - begin > time) {
      exec.cancel();
    }
  });
  exec.spin();

  const auto elapsed = std::chrono::nanoseconds(Clock::now() - begin).count();
  for (const auto &usage : exec.usage()) {
    std::cout << usage.name << " on CPU " << usage.cpu << " at priority " << usage.priority
              << ": amount_ns " << usage.amount_ns << " period_ns " << usage.period_ns
              << " elapsed_ns " << elapsed << " at_priority_ns " << usage.at_priority_ns
              << " background_ns " << usage.background_ns << " exhaustions " << usage.exhaustions
              << '\n';
  }
  return rounds > 0 ? 0 : 1;
}

}  // namespace

int main(int count, char **words) {
  rclcpp::init(count, words);
  int result = 1;
  try {
    const std::chrono::duration<double> seconds(count > 1 ? std::atof(words[1]) : 2.0);
    const std::int32_t cpu = count > 2 ? std::atoi(words[2]) : REPLENISH_ANY_CPU;
    result = run(std::chrono::duration_cast<Clock::duration>(seconds), cpu);
  } catch (const replenish::Error &error) {
    std::cerr << replenish_status_name(error.code()) << ": " << error.what() << '\n';
    result = error.code() == REPLENISH_NOT_PERMITTED ? 2 : 1;
  }
  rclcpp::shutdown();
  return result;
}
