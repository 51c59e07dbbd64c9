// The part that both foreign programs of `bench ros2` share: commands come line by line, a window of
// round trips answers with their times. A middleware gives `transmit` and `receive`.
//
// window BYTES COUNT PERIOD_NS   ->   times LOST NS NS …
// end of input: the program ends

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define PATIENCE 1000000000LL

// Sends a sample of `bytes` that begins with `number`.
static void transmit(uint64_t number, size_t bytes);
// Waits for the next sample until `until`; its number and length, or 0 if none came.
static size_t receive(uint64_t *number, int64_t until);

static int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static void sleep_until(int64_t at) {
    struct timespec to = {at / 1000000000LL, at % 1000000000LL};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &to, NULL)) {
    }
}

// When the sample came back; 0 if it did not in time.
static int64_t round_trip(uint64_t number, size_t bytes, int64_t patience) {
    int64_t until = now_ns() + patience;
    transmit(number, bytes);
    while (now_ns() < until) {
        uint64_t got = 0;
        if (receive(&got, until) && got == number)
            return now_ns();
    }
    return 0;
}

static void window(uint64_t *number, size_t bytes, long count, int64_t period, int64_t *times) {
    long kept = 0, lost = 0;
    int64_t at = now_ns() + period;
    for (long n = 0; n < count; n++) {
        sleep_until(at);
        int64_t sent = now_ns();
        int64_t back = round_trip(++*number, bytes, PATIENCE);
        if (back)
            times[kept++] = back - sent;
        else
            lost++;
        for (at += period; at < now_ns();)
            at += period;
    }
    printf("times %ld", lost);
    for (long n = 0; n < kept; n++)
        printf(" %lld", (long long)times[n]);
    putchar('\n');
}

static int ping(void) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    uint64_t number = 0;
    while (!round_trip(++number, 64, 50000000))
        if (number > 400)
            return 1;
    puts("ready");
    char line[128];
    while (fgets(line, sizeof line, stdin)) {
        size_t bytes;
        long count;
        long long period;
        if (sscanf(line, "window %zu %ld %lld", &bytes, &count, &period) != 3 || count < 1 || bytes < 64)
            return 2;
        int64_t *times = calloc((size_t)count, sizeof *times);
        if (!times)
            return 1;
        window(&number, bytes, count, period, times);
        free(times);
    }
    return 0;
}

static int echo(void) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    puts("ready");
    for (pid_t parent = getppid(); getppid() == parent;) {
        uint64_t number;
        size_t bytes = receive(&number, now_ns() + PATIENCE);
        if (bytes)
            transmit(number, bytes);
    }
    return 0;
}
