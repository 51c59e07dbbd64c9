/* Prints the least time of a tracepoint over 20 rounds of 100 000, in nanoseconds. Beside an LTTng
 * session that has it enabled; else it prints the time of a tracepoint that is off. */
#define LTTNG_UST_TRACEPOINT_CREATE_PROBES
#define LTTNG_UST_TRACEPOINT_DEFINE
#include "event.h"
#include <stdio.h>
#include <time.h>

static uint64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

int main(void) {
    uint64_t least = UINT64_MAX, n = 0;
    for (int round = 0; round < 20; round++) {
        uint64_t begin = now();
        for (int i = 0; i < 100000; i++, n++)
            lttng_ust_tracepoint(replenish_bench, event, 1, n, ~n);
        uint64_t took = now() - begin;
        least = took < least ? took : least;
    }
    printf("%.2f\n", (double)least / 100000.0);
    return 0;
}
