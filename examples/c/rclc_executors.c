/* rclc: two executors, each with a thread and a budget of its own, and a third in an ordinary thread that
 * ends the program.
 *
 *     rclc_executors [SECONDS [CPU]]
 */
#define _POSIX_C_SOURCE 200809L

#include <inttypes.h>
#include <rclc/executor.h>
#include <rclc/rclc.h>
#include <replenish_rclc.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static replenish_rclc all;
static uint64_t end;

static uint64_t now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

static void burn(uint64_t ns) {
  const uint64_t until = now() + ns;
  while (now() < until) {
  }
}

static void control(rcl_timer_t *timer, int64_t since) {
  (void)timer, (void)since;
  burn(1000000);
}

static void plan(rcl_timer_t *timer, int64_t since) {
  (void)timer, (void)since;
  burn(50000000);
}

static void watch(rcl_timer_t *timer, int64_t since) {
  (void)timer, (void)since;
  if (now() > end) {
    replenish_rclc_stop(&all);
  }
}

/* Prints what went wrong, and ends: 2 where only a privilege is missing. */
static void check(int32_t code) {
  if (code != REPLENISH_OK) {
    fprintf(stderr, "%s: %s\n", replenish_status_name(code), replenish_last_error());
    exit(code == REPLENISH_NOT_PERMITTED ? 2 : 1);
  }
}

static void checked(rcl_ret_t ret) {
  if (ret != RCL_RET_OK) {
    fprintf(stderr, "rclc answered %d\n", (int)ret);
    exit(1);
  }
}

int main(int count, char **words) {
  const struct {
    const char *name;
    uint64_t amount_ns;
    uint64_t period_ns;
    rcl_timer_callback_t callback;
    uint64_t every_ns;
  } each[3] = {
      {"control", 10000000, 50000000, control, 1000000},
      {"planner", 20000000, 100000000, plan, 1000000},
      {NULL, 0, 0, watch, 10000000},
  };
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rclc_support_t support;
  rcl_node_t node;
  rcl_timer_t timers[3];
  rclc_executor_t executors[3];
  uint64_t begin, elapsed;
  size_t i;

  checked(rclc_support_init(&support, count, (const char *const *)words, &allocator));
  checked(rclc_node_init_default(&node, "executors", "", &support));
  for (i = 0; i < 3; ++i) {
    executors[i] = rclc_executor_get_zero_initialized_executor();
    checked(rclc_executor_init(&executors[i], &support.context, 1, &allocator));
    timers[i] = rcl_get_zero_initialized_timer();
    checked(rclc_timer_init_default2(&timers[i], &support, each[i].every_ns, each[i].callback, true));
    checked(rclc_executor_add_timer(&executors[i], &timers[i]));
    if (each[i].name == NULL) {
      check(replenish_rclc_add(&all, &executors[i], NULL));
    } else {
      replenish_options options;
      check(replenish_options_init(&options, sizeof options));
      options.name = each[i].name;
      options.amount_ns = each[i].amount_ns;
      options.period_ns = each[i].period_ns;
      options.cpu = count > 2 ? atoi(words[2]) : REPLENISH_ANY_CPU;
      check(replenish_rclc_add(&all, &executors[i], &options));
    }
  }

  begin = now();
  end = begin + (uint64_t)((count > 1 ? atof(words[1]) : 2.0) * 1e9);
  check(replenish_rclc_spin(&all));
  elapsed = now() - begin;

  for (i = 0; i < 2; ++i) {
    replenish_usage usage;
    usage.size = sizeof usage;
    check(replenish_rclc_usage(&all, i, &usage));
    printf("%s on CPU %" PRId32 " at priority %" PRIu32 ": amount_ns %" PRIu64
           " period_ns %" PRIu64 " elapsed_ns %" PRIu64 " at_priority_ns %" PRIu64
           " background_ns %" PRIu64 " exhaustions %" PRIu64 "\n",
           usage.name, usage.cpu, usage.priority, usage.amount_ns, usage.period_ns, elapsed,
           usage.at_priority_ns, usage.background_ns, usage.exhaustions);
  }
  replenish_rclc_fini(&all);
  for (i = 0; i < 3; ++i) {
    checked(rclc_executor_fini(&executors[i]));
    checked(rcl_timer_fini(&timers[i]));
  }
  checked(rcl_node_fini(&node));
  checked(rclc_support_fini(&support));
  return 0;
}
