// A foreign program for `replenish bench foreign flood`: a control loop, and a stand-in for a
// middleware, `dds.udp.N`, whose threads take datagrams and work HANDLING microseconds on each.
// All threads have the policy of the first one, as with Fast DDS. Of every line `N` on standard
// input it runs N rounds of 2 ms with 300 us of work each and prints their responses in ns, from
// the release to the end of the work.
// usage: control THREADS HANDLING, prints "ready PORT"
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static long handling;
static int udp;

static long now(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * 1000000000L + t.tv_nsec;
}

static void work(long ns) {
    long end = now(CLOCK_THREAD_CPUTIME_ID) + ns;
    while (now(CLOCK_THREAD_CPUTIME_ID) < end) {}
}

static void *receive(void *name) {
    char text[2048];
    pthread_setname_np(pthread_self(), name);
    for (;;) {
        if (recv(udp, text, sizeof text, 0) >= 0) work(handling);
    }
    return 0;
}

int main(int argc, char **argv) {
    int threads = argc > 1 ? atoi(argv[1]) : 2;
    handling = (argc > 2 ? atol(argv[2]) : 20) * 1000;
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;
    udp = socket(AF_INET, SOCK_DGRAM, 0);
    if (udp < 0 || bind(udp, (struct sockaddr *)&at, sizeof at)) return 1;
    if (getsockname(udp, (struct sockaddr *)&at, &length)) return 1;
    static char names[16][16];
    for (int i = 0; i < threads && i < 16; i++) {
        pthread_t thread;
        snprintf(names[i], sizeof names[i], "dds.udp.%d", 7400 + i);
        if (pthread_create(&thread, 0, receive, names[i])) return 1;
    }
    printf("ready %d\n", ntohs(at.sin_port));
    fflush(stdout);
    char line[64];
    static long responses[100000];
    while (fgets(line, sizeof line, stdin)) {
        int rounds = atoi(line);
        if (rounds < 1 || rounds > 100000) return 1;
        long due = now(CLOCK_MONOTONIC) + 10000000;
        for (int i = 0; i < rounds; i++, due += 2000000) {
            struct timespec release = {due / 1000000000L, due % 1000000000L};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &release, 0);
            work(300000);
            responses[i] = now(CLOCK_MONOTONIC) - due;
        }
        for (int i = 0; i < rounds; i++) printf("%ld ", responses[i]);
        puts("");
        fflush(stdout);
    }
    return 0;
}
