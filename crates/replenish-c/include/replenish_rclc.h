/* Budgets for rclc: each executor gets a thread, and a budget if you say one. Header only, so that it is
 * compiled with the rclc of its user. C11, POSIX threads. Link -lreplenish.
 *
 *   static replenish_rclc all;                              // zeroed
 *   replenish_rclc_add(&all, &control, &options);           // REPLENISH_REFUSED if it does not fit
 *   replenish_rclc_add(&all, &rest, NULL);                  // an ordinary thread
 *   replenish_rclc_spin(&all);                              // until replenish_rclc_stop or a failure
 *
 * One executor for each group of callbacks keeps their budgets apart. All functions but
 * replenish_rclc_stop are for one thread.
 */
#ifndef REPLENISH_RCLC_H
#define REPLENISH_RCLC_H

#include "replenish.h"

#include <pthread.h>
#include <rclc/executor.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

/* Executors in one replenish_rclc. */
#define REPLENISH_RCLC_EXECUTORS 16

struct replenish_rclc;

struct replenish_rclc_thread {
  struct replenish_rclc *all;
  rclc_executor_t *executor;
  uint64_t budget; /* 0: none */
  pthread_t thread;
  int32_t code;    /* REPLENISH_OK, or why it has ended */
  rcl_ret_t ret;   /* rclc's last answer */
  char text[256];  /* the sentence to the code */
};

/* Executors with their threads. Begins with zeros. */
typedef struct replenish_rclc {
  struct replenish_rclc_thread threads[REPLENISH_RCLC_EXECUTORS];
  size_t count;
  atomic_bool stop;
} replenish_rclc;

/* Adds an executor before the spin. Its budget is made now: `options` as for replenish_budget_new, or NULL
 * for an ordinary thread. With an amount and a period of 0 it has a budget if the deployment file
 * (REPLENISH_OVERLAY) has a worker of that name, otherwise an ordinary thread. */
static inline int32_t replenish_rclc_add(replenish_rclc *all, rclc_executor_t *executor,
                                         const replenish_options *options) {
  struct replenish_rclc_thread *thread;
  uint64_t budget = 0;
  int32_t code;

  if (all == NULL || executor == NULL) {
    return REPLENISH_INVALID;
  }
  if (all->count == REPLENISH_RCLC_EXECUTORS) {
    return REPLENISH_FULL;
  }
  if (options != NULL) {
    code = replenish_budget_new(options, &budget);
    if (code == REPLENISH_NOT_FOUND) {
      budget = 0;
    } else if (code != REPLENISH_OK) {
      return code;
    }
  }
  thread = &all->threads[all->count++];
  memset(thread, 0, sizeof *thread);
  thread->all = all;
  thread->executor = executor;
  thread->budget = budget;
  return REPLENISH_OK;
}

/* Ends the spin; each executor ends with its wait, whose time rclc_executor_set_timeout says. From any
 * thread or callback, also before the spin. */
static inline void replenish_rclc_stop(replenish_rclc *all) { atomic_store(&all->stop, true); }

static inline void *replenish_rclc_run(void *argument) {
  struct replenish_rclc_thread *thread = argument;

  if (thread->budget != 0) {
    thread->code = replenish_budget_attach(thread->budget, 0);
    if (thread->code != REPLENISH_OK) {
      /* The text is this thread's. */
      snprintf(thread->text, sizeof thread->text, "%s", replenish_last_error());
    }
  }
  while (thread->code == REPLENISH_OK && !atomic_load(&thread->all->stop)) {
    thread->ret = rclc_executor_spin_some(thread->executor, thread->executor->timeout_ns);
    if (thread->ret != RCL_RET_OK && thread->ret != RCL_RET_TIMEOUT) {
      thread->code = REPLENISH_SYSTEM;
      snprintf(thread->text, sizeof thread->text, "rclc_executor_spin_some answered %d",
               (int)thread->ret);
    }
  }
  /* One that fails ends all. */
  atomic_store(&thread->all->stop, true);
  if (thread->budget != 0) {
    replenish_budget_detach(thread->budget, 0);
  }
  return NULL;
}

/* Runs each executor on its thread until replenish_rclc_stop, or until one of them fails: then the first
 * failure's code, and its sentence in `threads[…].text`. */
static inline int32_t replenish_rclc_spin(replenish_rclc *all) {
  int32_t code = REPLENISH_OK;
  size_t started = 0;
  size_t i;

  for (; started < all->count && code == REPLENISH_OK; started += code == REPLENISH_OK) {
    struct replenish_rclc_thread *thread = &all->threads[started];
    thread->code = REPLENISH_OK;
    if (pthread_create(&thread->thread, NULL, replenish_rclc_run, thread) != 0) {
      code = thread->code = REPLENISH_SYSTEM;
      snprintf(thread->text, sizeof thread->text, "no thread");
      atomic_store(&all->stop, true);
    }
  }
  for (i = 0; i < started; ++i) {
    pthread_join(all->threads[i].thread, NULL);
    if (code == REPLENISH_OK) {
      code = all->threads[i].code;
    }
  }
  atomic_store(&all->stop, false);
  return code;
}

/* The figures of an executor's budget, in the order in which they were added. REPLENISH_NOT_FOUND for one
 * without. Set `usage->size` before. */
static inline int32_t replenish_rclc_usage(const replenish_rclc *all, size_t place,
                                           replenish_usage *usage) {
  if (place >= all->count || all->threads[place].budget == 0) {
    return REPLENISH_NOT_FOUND;
  }
  return replenish_budget_usage(all->threads[place].budget, usage);
}

/* Ends the budgets, after the spin. The executors stay their owner's. */
static inline void replenish_rclc_fini(replenish_rclc *all) {
  size_t i;
  for (i = 0; i < all->count; ++i) {
    if (all->threads[i].budget != 0) {
      replenish_budget_release(all->threads[i].budget);
    }
  }
  all->count = 0;
}

#endif /* REPLENISH_RCLC_H */
