// A foreign program for `replenish bench foreign`: N threads that work without a pause, or BUSY
// microseconds in every PERIOD. usage: work N [BUSY PERIOD]
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static long busy, period;

static long now(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * 1000000000L + t.tv_nsec;
}

static void *work(void *name) {
    pthread_setname_np(pthread_self(), name);
    long due = now(CLOCK_MONOTONIC);
    for (;;) {
        if (busy) {
            long end = now(CLOCK_THREAD_CPUTIME_ID) + busy;
            while (now(CLOCK_THREAD_CPUTIME_ID) < end) {}
            due += period;
            struct timespec at = {due / 1000000000L, due % 1000000000L};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, 0);
        } else {
            for (volatile int i = 0; i < 1000; i++) {}
        }
    }
    return 0;
}

int main(int argc, char **argv) {
    int threads = argc > 1 ? atoi(argv[1]) : 1;
    busy = argc > 3 ? atol(argv[2]) * 1000 : 0;
    period = argc > 3 ? atol(argv[3]) * 1000 : 0;
    static char names[64][16];
    for (int i = 0; i < threads && i < 64; i++) {
        pthread_t thread;
        snprintf(names[i], sizeof names[i], "work%d", i);
        if (pthread_create(&thread, 0, work, names[i])) return 1;
    }
    puts("ready");
    fflush(stdout);
    for (;;) pause();
}
