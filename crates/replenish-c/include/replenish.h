/* libreplenish: CPU budgets for threads of C and C++ programs. Linux.
 *
 * Made from the Rust source; do not change it here. After a change there:
 *     REPLENISH_WRITE=1 cargo test -p replenish-c --test it
 *
 * Functions answer REPLENISH_OK (0) or a code; replenish_last_error() has the text. They may be
 * called from any thread, but not from a signal handler, and not in a child after fork().
 */

#ifndef REPLENISH_H
#define REPLENISH_H

#include <stddef.h>
#include <stdint.h>

/**
 * The version of this header: major, minor and patch in two, one and one byte.
 */
#define REPLENISH_VERSION 256

/**
 * Done.
 */
#define REPLENISH_OK 0

/**
 * An argument is null or out of its range; the text names it and the range.
 */
#define REPLENISH_INVALID 1

/**
 * The guarantee does not fit beside the others; the text says why, and what would fit.
 */
#define REPLENISH_REFUSED 2

/**
 * A privilege is missing; the text says how to grant it.
 */
#define REPLENISH_NOT_PERMITTED 3

/**
 * There is no such budget, or no such thread in this process; or neither the program nor the
 * deployment file says how large the budget is.
 */
#define REPLENISH_NOT_FOUND 4

/**
 * The thread has a budget already.
 */
#define REPLENISH_BUSY 5

/**
 * No room is left: 64 budgets on a CPU, 64 threads in a budget.
 */
#define REPLENISH_FULL 6

/**
 * This library or this system cannot do it.
 */
#define REPLENISH_UNSUPPORTED 7

/**
 * The system refused something; the text says what.
 */
#define REPLENISH_SYSTEM 8

/**
 * A fault of the library. Nothing was unwound into the caller.
 */
#define REPLENISH_INTERNAL 9

/**
 * The process is a fork of the one that made the budgets: it has none, and can make none.
 */
#define REPLENISH_FORKED 10

/**
 * As the plan chooses; a value of `replenish_options.cpu`.
 */
#define REPLENISH_ANY_CPU -1

/**
 * Without budget an ordinary thread; a value of `replenish_options.background`.
 */
#define REPLENISH_OTHER 0

/**
 * Without budget only when nothing else wants the CPU; a value of `replenish_options.background`.
 */
#define REPLENISH_IDLE -1

/**
 * Without budget not at all; a value of `replenish_options.background`. Not to be had yet:
 * REPLENISH_UNSUPPORTED.
 */
#define REPLENISH_SUSPEND -2

/**
 * Bytes of a budget's name, with the 0 at its end.
 */
#define REPLENISH_NAME 32

/**
 * A budget to be made. Set by replenish_options_init, then changed.
 */
typedef struct replenish_options {
  /**
   * sizeof(replenish_options), set by replenish_options_init.
   */
  size_t size;
  /**
   * Names the budget in reports, refusals and the deployment file: 1 to 31 bytes of UTF-8.
   * Copied. A worker of this name in the file that REPLENISH_OVERLAY names overrides the rest.
   */
  const char *name;
  /**
   * CPU time in every period, in nanoseconds; 1 to the deadline. 0, with a period of 0: only the
   * deployment file says.
   */
  uint64_t amount_ns;
  /**
   * The period in nanoseconds; 1 to a day.
   */
  uint64_t period_ns;
  /**
   * By when after a release the time must have been given, in nanoseconds; 1 to the period.
   * 0: the period.
   */
  uint64_t deadline_ns;
  /**
   * The CPU of the budget's threads. REPLENISH_ANY_CPU: the plan chooses.
   */
  int32_t cpu;
  /**
   * FIFO priority while there is budget, 1 to 98. 0: the plan chooses, and guarantees the
   * amount. Another value is an expert's: no guarantee, but those of others still hold.
   */
  uint32_t priority;
  /**
   * Without budget: REPLENISH_OTHER, REPLENISH_IDLE, or a FIFO priority from 1 on below the
   * budget's.
   */
  int32_t background;
  /**
   * 0. Keeps the size the same everywhere.
   */
  uint32_t reserved;
} replenish_options;

/**
 * A budget so far.
 */
typedef struct replenish_usage {
  /**
   * sizeof(replenish_usage), set by the caller.
   */
  size_t size;
  /**
   * Its name, ends with 0.
   */
  char name[REPLENISH_NAME];
  /**
   * CPU time in every period, in nanoseconds.
   */
  uint64_t amount_ns;
  /**
   * The period in nanoseconds.
   */
  uint64_t period_ns;
  /**
   * CPU time that its threads have used at its priority, in nanoseconds.
   */
  uint64_t at_priority_ns;
  /**
   * CPU time that they have used in the background, in nanoseconds.
   */
  uint64_t background_ns;
  /**
   * Times that it ran out.
   */
  uint64_t exhaustions;
  /**
   * Times that a replenishment raised its threads.
   */
  uint64_t replenishments;
  /**
   * The longest time until budget that is due is delivered, by the plan, in nanoseconds. 0: no
   * bound, or none that was asked for.
   */
  uint64_t worst_response_ns;
  /**
   * Threads that changed their policy or CPU by themselves, and were given theirs again.
   */
  uint64_t displaced;
  /**
   * Threads that have it now.
   */
  uint32_t threads;
  /**
   * Their CPU.
   */
  int32_t cpu;
  /**
   * FIFO priority while there is budget.
   */
  uint32_t priority;
  /**
   * 1 while its threads have that priority, otherwise 0.
   */
  uint32_t at_priority;
  /**
   * 1 if the kernel's switch records show when its threads wait, otherwise 0: then budget comes
   * back later than it could.
   */
  uint32_t sees_blocking;
  /**
   * 0. Keeps the size the same everywhere.
   */
  uint32_t reserved;
} replenish_usage;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library, in the form of REPLENISH_VERSION.
 */
uint32_t replenish_version(void);

/**
 * Whether the library fits a program that was compiled with a header of this version. Pass
 * REPLENISH_VERSION. REPLENISH_UNSUPPORTED if it does not.
 */
int32_t replenish_check_version(uint32_t header);

/**
 * The text of the last error of the calling thread, empty if there was none. It is the library's,
 * and stays until this thread's next call that fails.
 */
const char *replenish_last_error(void);

/**
 * The name of a code that a function answered with. Never null.
 */
const char *replenish_status_name(int32_t code);

/**
 * The number of the calling thread, for replenish_budget_attach from another one.
 */
int32_t replenish_thread_id(void);

/**
 * Sets every field to its default. `size` is sizeof(replenish_options).
 *
 * Pointers:
 * `options` is null or points to `size` bytes that may be written.
 */
int32_t replenish_options_init(struct replenish_options *options, size_t size);

/**
 * Makes a budget, without a thread, if it fits beside everything that was promised on this host.
 * Allocates, and can wait for other programs that are being admitted.
 *
 * `budget` gets its number, which is never 0 and never used again.
 *
 * Pointers:
 * `options` is null or points to as many bytes as its first field says; its name is null or ends
 * with 0. `budget` is null or may be written.
 */
int32_t replenish_budget_new(const struct replenish_options *options, uint64_t *budget);

/**
 * Gives a thread of this process the budget: from now on it runs on the budget's CPU, at the
 * priority while budget lasts. 0 is the calling thread. Threads of one budget share it.
 */
int32_t replenish_budget_attach(uint64_t budget, int32_t tid);

/**
 * Takes a thread out of the budget and gives it back the policy and CPUs that it had. 0 is the
 * calling thread. A thread that ends need not be detached.
 */
int32_t replenish_budget_detach(uint64_t budget, int32_t tid);

/**
 * Ends a budget: its threads get back what they had, and other programs may have its CPU time.
 */
int32_t replenish_budget_release(uint64_t budget);

/**
 * The figures of a budget so far. Set `usage->size` to sizeof(replenish_usage) before.
 *
 * Pointers:
 * `usage` is null or points to as many bytes as its first field says, which may be written.
 */
int32_t replenish_budget_usage(uint64_t budget, struct replenish_usage *usage);

/**
 * The numbers of all budgets of this process, in the order in which they were made. At most
 * `capacity` of them are written to `budgets`, which may be null if that is 0; `count` gets how
 * many there are.
 *
 * Pointers:
 * `budgets` is null or has room for `capacity` numbers; `count` is null or may be written.
 */
int32_t replenish_budget_list(uint64_t *budgets, size_t capacity, size_t *count);

/**
 * Makes a mark, a point of the program in its recording, which `replenish trace` shows.
 *
 * The same name gives the same mark. Allocates; the first call makes the recording, a file of 1 MB
 * in memory below /dev/shm, or where REPLENISH_LIVE says; REPLENISH_LIVE=off makes none.
 *
 * `mark` gets its number.
 *
 * Pointers:
 * `name` is null or ends with 0; `mark` is null or may be written.
 */
int32_t replenish_mark_new(const char *name, uint32_t *mark);

/**
 * Records that the calling thread has come to a mark, with a value of the program's choice.
 *
 * Reads the clock, and neither waits nor allocates, but for the thread's first mark. An error
 * leaves no text: REPLENISH_NOT_FOUND, there is no such mark; REPLENISH_FULL, 32 other threads
 * have marked something; REPLENISH_FORKED.
 */
int32_t replenish_mark(uint32_t mark, uint64_t value);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* REPLENISH_H */
