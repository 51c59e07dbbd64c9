// Two threads with budgets, one that asks for too much, and the report.
//
//     budgets [SECONDS [CPU]]
#include <replenish.hpp>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

namespace {

void work(const replenish::Budget &budget, Clock::duration time) {
  const replenish::Attached here(budget);
  const auto end = Clock::now() + time;
  while (Clock::now() < end) {
  }
}

int run(Clock::duration time, std::int32_t cpu) {
  replenish::Options more;
  more.cpu = cpu;
  const replenish::Budget control("control", {2ms, 10ms}, more);
  const replenish::Budget planner("planner", {20ms, 100ms}, more);
  try {
    const replenish::Budget greedy("greedy", {90ms, 100ms}, more);
    std::cerr << "greedy was admitted\n";
    return 1;
  } catch (const replenish::Error &refusal) {
    std::cout << "refused " << refusal.code() << ": " << refusal.what() << '\n';
  }

  const auto begin = Clock::now();
  std::thread first([&] { work(control, time); });
  std::thread second([&] { work(planner, time); });
  first.join();
  second.join();
  const auto elapsed = std::chrono::nanoseconds(Clock::now() - begin).count();
  for (const auto &usage : replenish::report()) {
    std::cout << usage.name << " on CPU " << usage.cpu << " at priority " << usage.priority
              << ": amount_ns " << usage.amount_ns << " period_ns " << usage.period_ns
              << " elapsed_ns " << elapsed << " at_priority_ns " << usage.at_priority_ns
              << " background_ns " << usage.background_ns << " exhaustions " << usage.exhaustions
              << '\n';
  }
  return 0;
}

}  // namespace

int main(int count, char **words) {
  try {
    const std::chrono::duration<double> seconds(count > 1 ? std::atof(words[1]) : 2.0);
    const std::int32_t cpu = count > 2 ? std::atoi(words[2]) : REPLENISH_ANY_CPU;
    return run(std::chrono::duration_cast<Clock::duration>(seconds), cpu);
  } catch (const replenish::Error &error) {
    std::cerr << replenish_status_name(error.code()) << ": " << error.what() << '\n';
    return error.code() == REPLENISH_NOT_PERMITTED ? 2 : 1;
  }
}
