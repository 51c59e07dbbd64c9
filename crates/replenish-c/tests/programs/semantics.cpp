// The headers' promises in one program, run under AddressSanitizer and UBSan with real-time
// priority. Prints `ok NAME` for each part.
#include <rclcpp/rclcpp.hpp>
#include <replenish_rclcpp.hpp>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <future>
#include <iostream>
#include <memory>
#include <pthread.h>
#include <sched.h>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

using namespace std::chrono_literals;

namespace {

void expect(bool holds, const char *what, int line) {
  if (!holds) {
    std::cerr << "line " << line << ": " << what << "; last error: " << replenish_last_error()
              << '\n';
    std::exit(1);
  }
}

#define EXPECT(what) expect((what), #what, __LINE__)

replenish::Options on(std::int32_t cpu) {
  replenish::Options more;
  more.cpu = cpu;
  return more;
}

// The kernel's answer: pthread_getschedparam remembers an older one.
int policy_of_this_thread() { return sched_getscheduler(0); }

// An object's end gives everything back, and a number is never used again.
void ends(std::int32_t cpu) {
  std::uint64_t old = 0;
  {
    replenish::Budget first("first", {1ms, 100ms}, on(cpu));
    old = first.id();
    replenish::Budget second = std::move(first);
    EXPECT(first.id() == 0 && second.id() == old);
    second.attach();
    EXPECT(second.usage().threads == 1);
    EXPECT(replenish_budget_attach(second.id(), 0) == REPLENISH_BUSY);
    // Assignment ends the budget that was there.
    second = replenish::Budget("third", {1ms, 100ms}, on(cpu));
    EXPECT(policy_of_this_thread() == SCHED_OTHER);
    EXPECT(replenish::report().size() == 1);
    EXPECT(std::strcmp(replenish::report().front().name, "third") == 0);
  }
  EXPECT(replenish::report().empty());
  EXPECT(replenish_budget_attach(old, 0) == REPLENISH_NOT_FOUND);
}

// A thread attaches another one, which ends without detaching.
void others(std::int32_t cpu) {
  const replenish::Budget budget("others", {5ms, 50ms}, on(cpu));
  std::promise<std::int32_t> number;
  std::promise<void> end;
  std::thread thread([&] {
    number.set_value(replenish_thread_id());
    end.get_future().wait();
  });
  const std::int32_t tid = number.get_future().get();
  budget.attach(tid);
  EXPECT(budget.usage().threads == 1);
  try {
    budget.detach();  // this one
    EXPECT(false);
  } catch (const replenish::Error &error) {
    EXPECT(error.code() == REPLENISH_NOT_FOUND);
  }
  end.set_value();
  thread.join();
  EXPECT(budget.usage().threads == 0);
  EXPECT(replenish_budget_attach(budget.id(), 1) == REPLENISH_NOT_FOUND);  // of another process
  EXPECT(replenish_budget_attach(budget.id(), tid) == REPLENISH_NOT_FOUND);
}

// Everything at once, from many threads.
void many(std::int32_t cpu) {
  std::atomic<int> made{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&made, cpu, i] {
      for (int round = 0; round < 25; ++round) {
        const replenish::Budget budget("many-" + std::to_string(i), {1ms, 100ms}, on(cpu));
        const replenish::Attached here(budget);
        EXPECT(budget.usage().threads == 1);
        EXPECT(!replenish::report().empty());
        EXPECT(replenish_budget_release(0) == REPLENISH_NOT_FOUND);
        EXPECT(std::string(replenish_last_error()).find("no budget 0") != std::string::npos);
        ++made;
      }
    });
  }
  for (auto &thread : threads) {
    thread.join();
  }
  EXPECT(made == 100);
  EXPECT(replenish::report().empty());
}

void forks() {
  const pid_t child = fork();
  EXPECT(child >= 0);
  if (child == 0) {
    std::size_t count = 0;
    _exit(replenish_mark(1, 0) == REPLENISH_FORKED ? replenish_budget_list(nullptr, 0, &count) : 99);
  }
  int status = 0;
  EXPECT(waitpid(child, &status, 0) == child);
  EXPECT(WIFEXITED(status) && WEXITSTATUS(status) == REPLENISH_FORKED);
}

// Marks of several threads, more threads than there is room for, and wrong ones.
void marks() {
  const replenish::Mark begun("begun");
  const replenish::Mark done("done");
  std::uint32_t again = 0;
  EXPECT(replenish_mark_new("begun", &again) == REPLENISH_OK && again == 1);
  EXPECT(replenish_mark_new("", &again) == REPLENISH_INVALID);
  EXPECT(replenish_mark(0, 0) == REPLENISH_NOT_FOUND);
  EXPECT(replenish_mark(9999, 0) == REPLENISH_NOT_FOUND);
  int full = 0;
  for (std::uint64_t n = 0; n < 40; ++n) {
    std::thread([&, n] {
      pthread_setname_np(pthread_self(), ("marks-" + std::to_string(n)).c_str());
      begun(n);
      done(n * n);
      full += replenish_mark(again, n) == REPLENISH_FULL;
    }).join();
  }
  EXPECT(full == 8);
}

// The executor for callback groups: refusal, an exception of a callback, cancel before spin.
void groups(std::int32_t cpu) {
  auto node = std::make_shared<rclcpp::Node>("semantics");
  const auto kind = rclcpp::CallbackGroupType::MutuallyExclusive;
  auto group = node->create_callback_group(kind, false);
  replenish::Executor exec;
  try {
    exec.add_callback_group(group, node, {99ms, 100ms}, on(cpu));
    EXPECT(false);
  } catch (const replenish::Error &refusal) {
    EXPECT(refusal.code() == REPLENISH_REFUSED);
    EXPECT(std::string(refusal.what()).find("would fit") != std::string::npos);
  }
  exec.add_callback_group(group, node, {5ms, 50ms}, on(cpu), "group");
  exec.add_node(node);
  exec.cancel();
  exec.spin();  // ends at once

  std::atomic<int> policy{-1};
  bool thrown = false;
  const auto timer = node->create_wall_timer(1ms, [&] {
    policy = policy_of_this_thread();
    throw std::runtime_error("from a callback");
  }, group);
  try {
    exec.spin();
  } catch (const std::runtime_error &error) {
    thrown = std::string(error.what()) == "from a callback";
  }
  EXPECT(thrown);
  EXPECT((policy & ~SCHED_RESET_ON_FORK) == SCHED_FIFO);
  EXPECT(exec.usage().size() == 1 && exec.usage().front().threads == 0);

  // Neither the program nor a file says a budget: an ordinary thread. (tests/c/run.rs has a file.)
  auto plain = node->create_callback_group(kind, false);
  replenish::Executor planned;
  planned.add_callback_group(plain, node, "planned");
  std::atomic<int> without{-1};
  const auto once = node->create_wall_timer(1ms, [&] {
    without = policy_of_this_thread();
    planned.cancel();
  }, plain);
  planned.spin();
  const auto file = std::getenv("REPLENISH_OVERLAY");
  EXPECT((without & ~SCHED_RESET_ON_FORK) == (file ? SCHED_FIFO : SCHED_OTHER));
  EXPECT(planned.usage().size() == (file ? 1u : 0u));
  EXPECT(!file || planned.usage().front().amount_ns == 2000000);

  // The end of rclcpp ends spin.
  group->timers.clear();
  std::thread end([] {
    std::this_thread::sleep_for(20ms);
    rclcpp::shutdown();
  });
  exec.spin();
  end.join();
}

}  // namespace

int main(int count, char **words) {
  const std::int32_t cpu = count > 2 ? std::atoi(words[2]) : REPLENISH_ANY_CPU;
  rclcpp::init(count, words);
  ends(cpu);
  std::cout << "ok ends\n";
  others(cpu);
  std::cout << "ok others\n";
  many(cpu);
  std::cout << "ok many\n";
  marks();
  std::cout << "ok marks\n";
  forks();
  std::cout << "ok forks\n";
  groups(cpu);
  std::cout << "ok groups\n";
  return 0;
}
