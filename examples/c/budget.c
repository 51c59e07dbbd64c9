/* A thread that works without a pause and gets 10 ms of CPU time in every 50 ms at its priority; the
 * rest of its work runs in the background.
 *
 *     budget [SECONDS [CPU]]
 *
 * Build: cc budget.c $(pkg-config --cflags --libs replenish) -pthread
 */
#define _POSIX_C_SOURCE 200809L

#include <inttypes.h>
#include <pthread.h>
#include <replenish.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static uint64_t now(clockid_t clock) {
  struct timespec time;
  clock_gettime(clock, &time);
  return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

/* Prints what went wrong, and ends: 2 where only a privilege is missing. */
static void check(int32_t code) {
  if (code != REPLENISH_OK) {
    fprintf(stderr, "%s: %s\n", replenish_status_name(code), replenish_last_error());
    exit(code == REPLENISH_NOT_PERMITTED ? 2 : 1);
  }
}

struct work {
  uint64_t budget;
  uint64_t elapsed; /* in nanoseconds, with the budget */
  double seconds;
};

static void *work(void *argument) {
  struct work *work = argument;
  const uint64_t begin = now(CLOCK_MONOTONIC);
  const uint64_t end = begin + (uint64_t)(work->seconds * 1e9);
  check(replenish_budget_attach(work->budget, 0));
  while (now(CLOCK_MONOTONIC) < end) {
  }
  check(replenish_budget_detach(work->budget, 0));
  work->elapsed = now(CLOCK_MONOTONIC) - begin;
  return NULL;
}

int main(int count, char **words) {
  struct work mine = {0, 0, count > 1 ? atof(words[1]) : 2.0};
  replenish_options options;
  replenish_usage usage;
  pthread_t thread;

  check(replenish_check_version(REPLENISH_VERSION));
  check(replenish_options_init(&options, sizeof options));
  options.name = "worker";
  options.amount_ns = 10000000;
  options.period_ns = 50000000;
  options.cpu = count > 2 ? atoi(words[2]) : REPLENISH_ANY_CPU;
  check(replenish_budget_new(&options, &mine.budget));
  if (pthread_create(&thread, NULL, work, &mine) != 0 || pthread_join(thread, NULL) != 0) {
    fputs("no thread\n", stderr);
    return 1;
  }

  usage.size = sizeof usage;
  check(replenish_budget_usage(mine.budget, &usage));
  printf("%s on CPU %" PRId32 " at priority %" PRIu32 ": amount_ns %" PRIu64 " period_ns %" PRIu64
         " elapsed_ns %" PRIu64 " at_priority_ns %" PRIu64 " background_ns %" PRIu64
         " exhaustions %" PRIu64 "\n",
         usage.name, usage.cpu, usage.priority, usage.amount_ns, usage.period_ns, mine.elapsed,
         usage.at_priority_ns, usage.background_ns, usage.exhaustions);
  check(replenish_budget_release(mine.budget));
  return 0;
}
