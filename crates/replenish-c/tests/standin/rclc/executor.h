/* A stand-in for rclc and the part of rcl that its example uses, which are in no package index: their
 * signatures as in rclc's executor.h, init.h, node.h and timer.h of Humble to Rolling, over timers alone.
 * For tests. */
#ifndef STANDIN_RCLC_EXECUTOR_H
#define STANDIN_RCLC_EXECUTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <threads.h>
#include <time.h>

typedef int32_t rcl_ret_t;
#define RCL_RET_OK 0
#define RCL_RET_ERROR 1
#define RCL_RET_TIMEOUT 2

typedef struct rcl_allocator_t {
  void *state;
} rcl_allocator_t;
typedef struct rcl_context_t {
  bool valid;
} rcl_context_t;
typedef struct rcl_node_t {
  const char *name;
} rcl_node_t;

struct rcl_timer_t;
typedef void (*rcl_timer_callback_t)(struct rcl_timer_t *, int64_t);
typedef struct rcl_timer_t {
  uint64_t period;
  uint64_t next;
  rcl_timer_callback_t callback;
} rcl_timer_t;

typedef struct rclc_support_t {
  rcl_context_t context;
} rclc_support_t;

#define STANDIN_HANDLES 8
typedef struct rclc_executor_t {
  rcl_context_t *context;
  rcl_timer_t *timers[STANDIN_HANDLES];
  size_t max_handles;
  size_t index;
  uint64_t timeout_ns;
} rclc_executor_t;

static inline uint64_t standin_now(void) {
  struct timespec now;
  timespec_get(&now, TIME_UTC);
  return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static inline rcl_allocator_t rcl_get_default_allocator(void) {
  const rcl_allocator_t none = {NULL};
  return none;
}

static inline rcl_ret_t rclc_support_init(rclc_support_t *support, int argc,
                                          char const *const *argv, rcl_allocator_t *allocator) {
  (void)argc, (void)argv, (void)allocator;
  support->context.valid = true;
  return RCL_RET_OK;
}

static inline rcl_ret_t rclc_support_fini(rclc_support_t *support) {
  support->context.valid = false;
  return RCL_RET_OK;
}

static inline rcl_ret_t rclc_node_init_default(rcl_node_t *node, const char *name,
                                               const char *namespace_, rclc_support_t *support) {
  (void)namespace_, (void)support;
  node->name = name;
  return RCL_RET_OK;
}

static inline rcl_ret_t rcl_node_fini(rcl_node_t *node) {
  node->name = NULL;
  return RCL_RET_OK;
}

static inline rcl_timer_t rcl_get_zero_initialized_timer(void) {
  const rcl_timer_t none = {0, 0, NULL};
  return none;
}

static inline rcl_ret_t rclc_timer_init_default2(rcl_timer_t *timer, rclc_support_t *support,
                                                 const uint64_t timeout_ns,
                                                 const rcl_timer_callback_t callback,
                                                 bool autostart) {
  (void)support, (void)autostart;
  timer->period = timeout_ns;
  timer->next = standin_now() + timeout_ns;
  timer->callback = callback;
  return RCL_RET_OK;
}

static inline rcl_ret_t rcl_timer_fini(rcl_timer_t *timer) {
  timer->callback = NULL;
  return RCL_RET_OK;
}

static inline rclc_executor_t rclc_executor_get_zero_initialized_executor(void) {
  const rclc_executor_t none = {NULL, {NULL}, 0, 0, 0};
  return none;
}

static inline rcl_ret_t rclc_executor_init(rclc_executor_t *executor, rcl_context_t *context,
                                           const size_t number_of_handles,
                                           const rcl_allocator_t *allocator) {
  (void)allocator;
  *executor = rclc_executor_get_zero_initialized_executor();
  executor->context = context;
  executor->max_handles = number_of_handles;
  executor->timeout_ns = 100000000;
  return number_of_handles <= STANDIN_HANDLES ? RCL_RET_OK : RCL_RET_ERROR;
}

static inline rcl_ret_t rclc_executor_fini(rclc_executor_t *executor) {
  executor->index = 0;
  return RCL_RET_OK;
}

static inline rcl_ret_t rclc_executor_set_timeout(rclc_executor_t *executor,
                                                  const uint64_t timeout_ns) {
  executor->timeout_ns = timeout_ns;
  return RCL_RET_OK;
}

static inline rcl_ret_t rclc_executor_add_timer(rclc_executor_t *executor, rcl_timer_t *timer) {
  if (executor->index == executor->max_handles) {
    return RCL_RET_ERROR;
  }
  executor->timers[executor->index++] = timer;
  return RCL_RET_OK;
}

static inline rcl_ret_t rclc_executor_spin_some(rclc_executor_t *executor,
                                                const uint64_t timeout_ns) {
  const uint64_t end = standin_now() + timeout_ns;
  const struct timespec pause = {0, 200000};
  if (executor->context == NULL || !executor->context->valid) {
    return RCL_RET_ERROR;
  }
  do {
    bool worked = false;
    for (size_t i = 0; i < executor->index; ++i) {
      rcl_timer_t *timer = executor->timers[i];
      const uint64_t now = standin_now();
      if (now >= timer->next) {
        timer->next = now > timer->next + timer->period ? now : timer->next + timer->period;
        timer->callback(timer, 0);
        worked = true;
      }
    }
    if (worked) {
      return RCL_RET_OK;
    }
    thrd_sleep(&pause, NULL);
  } while (standin_now() < end);
  return RCL_RET_TIMEOUT;
}

#endif /* STANDIN_RCLC_EXECUTOR_H */
