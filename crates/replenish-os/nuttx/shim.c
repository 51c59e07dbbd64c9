/* What the Rust side of the NuttX back end calls: functions with plain types, so that no type of
 * the system is described twice. The application's Makefile compiles it with the image. On another
 * POSIX system it is compiled for tests. */
#ifdef __NuttX__
#  include <nuttx/config.h>
#  include <nuttx/irq.h>
#  include <nuttx/sched.h>
#  include <nuttx/semaphore.h>
#  include <nuttx/tls.h>
#  ifdef CONFIG_DRIVERS_NOTE
#    include <nuttx/note/note_driver.h>
#  endif
#else
#  define _GNU_SOURCE
#  include <sys/resource.h>
#  include <sys/time.h>
#endif
#include <errno.h>
#include <limits.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define RP_VERSION 1
#define RP_NEVER UINT64_MAX

/* One thread; the Rust side has the memory. */
struct rp_thread {
    pthread_t id;
    sem_t park;
    int priority; /* set last */
};

/* What the Rust side checks before the first thread is made. */
struct rp_report {
    uint32_t bytes, version;
    uint32_t thread_bytes, thread_align;
    uint32_t attr_bytes, param_bytes, mutex_bytes, time_bytes;
    uint32_t misfits;  /* types that the system's functions write beyond */
    uint32_t features; /* RP_... */
    uint32_t max_repl; /* of the system's own sporadic policy */
    int32_t lowest;    /* the priority of a thread that asked for none */
    int32_t started;   /* error number of rp_start_up() */
    uint32_t unused;
    uint64_t resolution; /* of the clock, ns */
    uint64_t step;       /* of waits, ns: the system's tick */
};
enum { RP_MASKS = 1, RP_SWITCHES = 2, RP_SPORADIC = 4, RP_ROUND_ROBIN = 8 };

/* A policy as the Rust side says it. */
struct rp_policy {
    int32_t kind; /* 0 the lowest, 1 FIFO, 2 round-robin, 3 SCHED_SPORADIC */
    int32_t priority, low, max_repl;
    uint64_t budget, period;
};

extern void rp_thread_gone(void *slot);
extern void rp_switched_out(void *slot, uint32_t preempted);
extern void rp_switched_in(void *slot);

static struct timespec timespec_of(uint64_t ns)
{
    struct timespec t;
    t.tv_sec = (time_t)(ns / 1000000000u);
    t.tv_nsec = (long)(ns % 1000000000u);
    return t;
}

static uint64_t nanos(const struct timespec *t)
{
    return (uint64_t)t->tv_sec * 1000000000u + (uint64_t)t->tv_nsec;
}

static uint64_t kernel_now(void)
{
    struct timespec t;
    return clock_gettime(CLOCK_MONOTONIC, &t) == 0 ? nanos(&t) : 0;
}

/* An image with a finer clock than the system's says -DRP_CLOCK=its_function. */
#ifdef RP_CLOCK
extern uint64_t RP_CLOCK(void);
uint64_t rp_board_now(void) { return RP_CLOCK(); }
#else
uint64_t rp_board_now(void) { return kernel_now(); }
#endif

/* ---- which slot the calling thread has, and who must not interrupt ---- */

static pthread_once_t once = PTHREAD_ONCE_INIT;
static pthread_key_t key;
static int started;

#ifdef __NuttX__

static struct task_group_s *group; /* the application; others' keys mean something else */

static void *slot_of(struct tcb_s *tcb)
{
#  if CONFIG_TLS_NELEM > 0
    if (tcb == NULL || group == NULL || tcb->group != group) return NULL;
    struct tls_info_s *tls = (struct tls_info_s *)tcb->stack_alloc_ptr;
    return tls == NULL ? NULL : (void *)tls->tl_elem[key];
#  else
    return NULL;
#  endif
}

void *rp_current(void) { return slot_of(nxsched_self()); }

/* Interrupts off, and with them switches: one CPU. Nests. */
_Static_assert(sizeof(irqstate_t) <= sizeof(uint32_t), "processors of 32 bits only");
uint32_t rp_mask(void) { return (uint32_t)enter_critical_section(); }
void rp_unmask(uint32_t before) { leave_critical_section((irqstate_t)before); }

#  if defined(CONFIG_SCHED_INSTRUMENTATION_SWITCH) && defined(CONFIG_DRIVERS_NOTE)
static void noted_suspend(struct note_driver_s *driver, struct tcb_s *tcb)
{
    (void)driver;
    void *slot = slot_of(tcb);
    if (slot != NULL) rp_switched_out(slot, tcb->task_state <= LAST_READY_TO_RUN_STATE);
}

static void noted_resume(struct note_driver_s *driver, struct tcb_s *tcb)
{
    (void)driver;
    void *slot = slot_of(tcb);
    if (slot != NULL) rp_switched_in(slot);
}

static void noted_nothing(struct note_driver_s *driver, const void *note, size_t bytes)
{
    (void)driver;
    (void)note;
    (void)bytes;
}

static void noted_thread(struct note_driver_s *driver, struct tcb_s *tcb)
{
    (void)driver;
    (void)tcb;
}

static const struct note_driver_ops_s note_ops = {
    .add = noted_nothing,
    .start = noted_thread,
    .stop = noted_thread,
    .suspend = noted_suspend,
    .resume = noted_resume,
};
static struct note_driver_s note_driver = {
#    ifdef CONFIG_SCHED_INSTRUMENTATION_FILTER
    .name = "replenish",
    .filter = {.mode = {.flag = NOTE_FILTER_MODE_FLAG_ENABLE | NOTE_FILTER_MODE_FLAG_SWITCH}},
#    endif
    .ops = &note_ops,
};
#    define REGISTER_HOOKS() (-note_driver_register(&note_driver))
#    define HOOKS RP_SWITCHES
#  else
#    define REGISTER_HOOKS() 0
#    define HOOKS 0
#  endif

static void start_up(void)
{
    group = nxsched_self()->group;
#  if CONFIG_TLS_NELEM > 0
    started = pthread_key_create(&key, rp_thread_gone);
    if (started == 0) started = REGISTER_HOOKS();
#  else
    started = ENOTSUP;
#  endif
}

#else /* a host, for tests */

static pthread_mutex_t mask;
static _Thread_local void *slot;
#  define HOOKS 0

static void start_up(void)
{
    pthread_mutexattr_t attr;
    pthread_mutexattr_init(&attr);
    pthread_mutexattr_settype(&attr, PTHREAD_MUTEX_RECURSIVE);
    pthread_mutexattr_setprotocol(&attr, PTHREAD_PRIO_INHERIT);
    started = pthread_mutex_init(&mask, &attr);
    if (started == 0) started = pthread_key_create(&key, rp_thread_gone);
}

void *rp_current(void) { return slot; }

/* No interrupts here: one lock, with inheritance, stands for them. */
uint32_t rp_mask(void)
{
    pthread_once(&once, start_up);
    pthread_mutex_lock(&mask);
    return 0;
}

void rp_unmask(uint32_t before)
{
    (void)before;
    pthread_mutex_unlock(&mask);
}

#endif

/* ---- what the Rust side checks ---- */

/* Whether a function of the system stays within the type as it is known here: the shim and the
 * image may have been compiled with different configurations. */
#define MISFIT(bit, type, call)                                              \
    do {                                                                     \
        union {                                                              \
            type value;                                                      \
            unsigned char bytes[2 * sizeof(type) + 64];                      \
        } probe;                                                             \
        memset(probe.bytes, 0xa5, sizeof probe.bytes);                       \
        type *it = &probe.value;                                             \
        (void)(call);                                                        \
        for (size_t i = sizeof(type); i < sizeof probe.bytes; i++)           \
            if (probe.bytes[i] != 0xa5) misfits |= (uint32_t)1 << (bit);     \
    } while (0)

static uint32_t find_misfits(void)
{
    uint32_t misfits = 0;
    int policy;
    MISFIT(0, pthread_attr_t, pthread_attr_init(it));
    MISFIT(1, struct sched_param, pthread_getschedparam(pthread_self(), &policy, it));
    MISFIT(2, sem_t, sem_init(it, 0, 0));
    MISFIT(3, struct timespec, clock_gettime(CLOCK_MONOTONIC, it));
    return misfits;
}

void rp_start_up(struct rp_report *report)
{
    struct timespec t = {0, 0};
    pthread_once(&once, start_up);
    memset(report, 0, sizeof *report);
    report->bytes = sizeof *report;
    report->version = RP_VERSION;
    report->thread_bytes = sizeof(struct rp_thread);
    report->thread_align = _Alignof(struct rp_thread);
    report->attr_bytes = sizeof(pthread_attr_t);
    report->param_bytes = sizeof(struct sched_param);
    report->mutex_bytes = sizeof(pthread_mutex_t);
    report->time_bytes = sizeof(time_t);
    report->misfits = find_misfits();
    report->started = started;
    report->features = HOOKS;
#ifdef __NuttX__
    report->lowest = SCHED_PRIORITY_MIN;
#  if !defined(CONFIG_SMP) && defined(CONFIG_BUILD_FLAT)
    report->features |= RP_MASKS;
#  endif
#  ifdef CONFIG_SCHED_SPORADIC
    report->features |= RP_SPORADIC;
    report->max_repl = CONFIG_SCHED_SPORADIC_MAXREPL;
#  endif
#  if CONFIG_RR_INTERVAL > 0
    report->features |= RP_ROUND_ROBIN;
#  endif
#else
    report->features |= RP_MASKS | RP_ROUND_ROBIN;
#endif
    report->step = clock_getres(CLOCK_MONOTONIC, &t) == 0 ? nanos(&t) : 0;
#ifdef RP_CLOCK
    report->resolution = 1;
#else
    report->resolution = report->step;
#endif
}

/* ---- threads ---- */

int32_t rp_thread_init(struct rp_thread *thread)
{
    if (sem_init(&thread->park, 0, 0) != 0) return errno;
#if defined(__NuttX__) && defined(CONFIG_PRIORITY_INHERITANCE)
    sem_setprotocol(&thread->park, SEM_PRIO_NONE); /* it tells, it does not lock */
#endif
    return 0;
}

static int remember(void *its_slot)
{
#if defined(__NuttX__) && CONFIG_TLS_NELEM == 0
    (void)its_slot;
    return ENOTSUP; /* the check at start has said so */
#else
    return pthread_setspecific(key, its_slot);
#endif
}

/* The calling thread is `thread` from now on. */
int32_t rp_adopt(struct rp_thread *thread, void *its_slot)
{
    struct sched_param param;
    int policy;
#ifdef __NuttX__
    if (nxsched_self()->group != group) return EPERM;
#else
    slot = its_slot;
#endif
    thread->id = pthread_self();
    if (pthread_getschedparam(thread->id, &policy, &param) == 0)
        thread->priority = param.sched_priority;
    return remember(its_slot);
}

/* The calling thread is none of ours any more. */
void rp_forget(void)
{
#ifndef __NuttX__
    slot = NULL;
#endif
    (void)remember(NULL);
}

static int policy_of(int kind)
{
    switch (kind) {
#ifdef CONFIG_SCHED_SPORADIC
    case 3: return SCHED_SPORADIC;
#endif
    case 2: return SCHED_RR;
#ifndef __NuttX__
    case 0: return SCHED_OTHER;
#endif
    default: return SCHED_FIFO;
    }
}

int32_t rp_thread_create(void *(*entry)(void *), void *argument, size_t stack,
                         const struct rp_policy *policy, uint64_t *number)
{
    pthread_attr_t attr;
    pthread_t id;
    struct sched_param param;
    int error = pthread_attr_init(&attr);
    if (error != 0) return error;
    memset(&param, 0, sizeof param);
    param.sched_priority = policy->priority;
#ifdef CONFIG_SCHED_SPORADIC
    param.sched_ss_low_priority = policy->low;
    param.sched_ss_repl_period = timespec_of(policy->period);
    param.sched_ss_init_budget = timespec_of(policy->budget);
    param.sched_ss_max_repl = policy->max_repl;
#endif
#ifndef __NuttX__
    stack += 128 * 1024; /* the host's libraries need more than a board's */
#endif
    pthread_attr_setinheritsched(&attr, PTHREAD_EXPLICIT_SCHED);
    error = pthread_attr_setschedpolicy(&attr, policy_of(policy->kind));
    if (error == 0) error = pthread_attr_setschedparam(&attr, &param);
    if (error == 0) error = pthread_attr_setdetachstate(&attr, PTHREAD_CREATE_DETACHED);
    if (error == 0) error = pthread_attr_setstacksize(&attr, stack);
    if (error == 0) error = pthread_create(&id, &attr, entry, argument);
    pthread_attr_destroy(&attr);
    *number = error == 0 ? (uint64_t)id : 0;
    return error;
}

/* The creator knows the thread before that has run for the first time. */
void rp_thread_note(struct rp_thread *thread, uint64_t number, int32_t priority)
{
    thread->id = (pthread_t)number;
    thread->priority = priority;
}

void rp_name(const char *name)
{
#if !defined(__NuttX__) || CONFIG_TASK_NAME_SIZE > 0
    char first[16];
    strncpy(first, name, sizeof first - 1);
    first[sizeof first - 1] = 0;
    pthread_setname_np(pthread_self(), first);
#else
    (void)name;
#endif
}

/* The calling thread waits until it is woken or `until` has come; too early does no harm. */
void rp_park(struct rp_thread *thread, uint64_t until)
{
    if (until == RP_NEVER) {
        (void)sem_wait(&thread->park);
        return;
    }
#ifdef RP_CLOCK
    uint64_t now = rp_board_now();
    until = kernel_now() + (until > now ? until - now : 0);
#endif
    if (until / 1000000000u > INT32_MAX) until = (uint64_t)INT32_MAX * 1000000000u;
    struct timespec at = timespec_of(until);
    (void)sem_clockwait(&thread->park, CLOCK_MONOTONIC, &at);
}

/* From any thread, and on NuttX from interrupts. */
void rp_unpark(struct rp_thread *thread) { (void)sem_post(&thread->park); }

/* ---- priorities ---- */

/* The thread goes to the tail of its new list. */
int32_t rp_set_priority(struct rp_thread *thread, int32_t priority)
{
    int32_t before = thread->priority;
    thread->priority = priority;
#ifdef __NuttX__
    (void)before;
    return pthread_setschedprio(thread->id, priority < SCHED_PRIORITY_MIN ? SCHED_PRIORITY_MIN : priority);
#else
    struct sched_param param = {.sched_priority = priority};
    if (priority > 0 && priority < before) { /* Linux: lowered is head, raised is tail */
        struct sched_param below = {.sched_priority = priority - 1};
        pthread_setschedparam(thread->id, priority > 1 ? SCHED_FIFO : SCHED_OTHER, &below);
    }
    return pthread_setschedparam(thread->id, priority > 0 ? SCHED_FIFO : SCHED_OTHER, &param);
#endif
}

int32_t rp_set_round_robin(struct rp_thread *thread, int32_t priority)
{
    struct sched_param param;
    memset(&param, 0, sizeof param);
    param.sched_priority = priority;
    thread->priority = priority;
    return pthread_setschedparam(thread->id, SCHED_RR, &param);
}

/* What the system says the thread has. */
int32_t rp_policy_of(struct rp_thread *thread, struct rp_policy *policy)
{
    struct sched_param param;
    int kind = 0;
    memset(policy, 0, sizeof *policy);
    memset(&param, 0, sizeof param);
    int error = pthread_getschedparam(thread->id, &kind, &param);
    if (error != 0) return error;
    policy->priority = param.sched_priority;
    policy->kind = kind == SCHED_FIFO ? 1 : kind == SCHED_RR ? 2 : 0;
#ifdef CONFIG_SCHED_SPORADIC
    if (kind == SCHED_SPORADIC) {
        policy->kind = 3;
        policy->low = param.sched_ss_low_priority;
        policy->max_repl = param.sched_ss_max_repl;
        policy->budget = nanos(&param.sched_ss_init_budget);
        policy->period = nanos(&param.sched_ss_repl_period);
    }
#endif
    return 0;
}

void rp_yield(void) { (void)sched_yield(); }

/* ---- where there are no switch hooks ---- */

uint64_t rp_cpu_time(struct rp_thread *thread)
{
#ifdef __NuttX__
    (void)thread;
    return 0;
#else
    clockid_t clock;
    struct timespec t;
    if (pthread_getcpuclockid(thread->id, &clock) != 0 || clock_gettime(clock, &t) != 0) return 0;
    return nanos(&t);
#endif
}

uint64_t rp_blocks(void)
{
#ifdef __NuttX__
    return 0;
#else
    struct rusage usage;
    return getrusage(RUSAGE_THREAD, &usage) == 0 ? (uint64_t)usage.ru_nvcsw : 0;
#endif
}

/* ---- memory and console ---- */

void *rp_malloc(size_t align, size_t bytes)
{
    void *block = NULL;
    if (align <= sizeof(void *)) return malloc(bytes);
    return posix_memalign(&block, align, bytes) == 0 ? block : NULL;
}

void rp_free(void *block) { free(block); }

void rp_print(const char *text, size_t bytes)
{
    while (bytes > 0) {
        ssize_t done = write(STDERR_FILENO, text, bytes);
        if (done <= 0) return;
        text += done;
        bytes -= (size_t)done;
    }
}
