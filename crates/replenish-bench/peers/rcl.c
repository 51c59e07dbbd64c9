// One end of a round trip over genuine rcl and its middleware: bytes are published and taken in
// serialized form, a new one rings an eventfd. Python loads it (rcl.py), since the libraries of the
// package index want Python's symbols. Role `control` is `echo` with a second thread that takes the
// topic `flood`, and works 20 us of CPU time on each message.
#include "round_trip.h"
#include <poll.h>
#include <pthread.h>
#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <std_msgs/msg/u_int64.h>
#include <std_msgs/msg/u_int8_multi_array.h>
#include <sys/eventfd.h>
#include <unistd.h>

static rcl_publisher_t publisher;
static rcl_subscription_t subscription, flooded;
static rcl_serialized_message_t out, in, poured;
static int bell, flood_bell;

// Encapsulation, no dimensions, no offset, length.
#define HEAD 16

static void transmit(uint64_t number, size_t bytes) {
    static const uint8_t encapsulation[4] = {0, 1, 0, 0};
    uint32_t length = (uint32_t)(bytes - 12);
    memset(out.buffer, 0, HEAD);
    memcpy(out.buffer, encapsulation, 4);
    memcpy(out.buffer + 12, &length, 4);
    memcpy(out.buffer + HEAD, &number, 8);
    out.buffer_length = bytes + 4;
    if (rcl_publish_serialized_message(&publisher, &out, NULL) != RCL_RET_OK)
        fprintf(stderr, "%s\n", rcl_get_error_string().str);
}

static void rung(const void *of, size_t count) {
    uint64_t one = count;
    if (write(*(const int *)of, &one, sizeof one) < 0)
        perror("eventfd");
}

static size_t receive(uint64_t *number, int64_t until) {
    for (;;) {
        if (rcl_take_serialized_message(&subscription, &in, NULL, NULL) == RCL_RET_OK) {
            if (in.buffer_length < HEAD + 8)
                return 0;
            memcpy(number, in.buffer + HEAD, 8);
            return in.buffer_length - 4;
        }
        rcl_reset_error();
        int64_t left = until - now_ns();
        if (left <= 0)
            return 0;
        struct pollfd wait = {bell, POLLIN, 0};
        uint64_t count;
        if (poll(&wait, 1, (int)(left / 1000000 + 1)) > 0 && read(bell, &count, sizeof count) < 0)
            return 0;
    }
}

static int64_t cpu_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static void *take_flood(void *unused) {
    for (;;) {
        if (rcl_take_serialized_message(&flooded, &poured, NULL, NULL) == RCL_RET_OK) {
            for (int64_t end = cpu_ns() + 20000; cpu_ns() < end;) {
            }
            continue;
        }
        rcl_reset_error();
        uint64_t count;
        if (read(flood_bell, &count, sizeof count) < 0)
            return unused;
    }
}

static void need(rcl_ret_t ret) {
    if (ret != RCL_RET_OK) {
        fprintf(stderr, "%s\n", rcl_get_error_string().str);
        exit(1);
    }
}

int run(const char *role) {
    int pings = !strcmp(role, "ping");
    rcl_allocator_t allocator = rcl_get_default_allocator();
    static rcl_context_t context;
    static rcl_node_t node;
    context = rcl_get_zero_initialized_context();
    node = rcl_get_zero_initialized_node();
    rcl_init_options_t options = rcl_get_zero_initialized_init_options();
    need(rcl_init_options_init(&options, allocator));
    need(rcl_init(0, NULL, &options, &context));
    rcl_node_options_t node_options = rcl_node_get_default_options();
    need(rcl_node_init(&node, pings ? "ping" : "echo", "", &context, &node_options));
    const rosidl_message_type_support_t *type = ROSIDL_GET_MSG_TYPE_SUPPORT(std_msgs, msg, UInt8MultiArray);
    publisher = rcl_get_zero_initialized_publisher();
    subscription = rcl_get_zero_initialized_subscription();
    rcl_publisher_options_t of_publisher = rcl_publisher_get_default_options();
    rcl_subscription_options_t of_subscription = rcl_subscription_get_default_options();
    out = rmw_get_zero_initialized_serialized_message();
    in = rmw_get_zero_initialized_serialized_message();
    need(rmw_serialized_message_init(&out, 2u << 20, &allocator));
    need(rmw_serialized_message_init(&in, 2u << 20, &allocator));
    bell = eventfd(0, EFD_CLOEXEC);
    need(rcl_publisher_init(&publisher, &node, type, pings ? "there" : "back", &of_publisher));
    need(rcl_subscription_init(&subscription, &node, type, pings ? "back" : "there", &of_subscription));
    need(rcl_subscription_set_on_new_message_callback(&subscription, rung, &bell));
    if (!strcmp(role, "control")) {
        flooded = rcl_get_zero_initialized_subscription();
        poured = rmw_get_zero_initialized_serialized_message();
        need(rmw_serialized_message_init(&poured, 64, &allocator));
        flood_bell = eventfd(0, EFD_CLOEXEC);
        const rosidl_message_type_support_t *number = ROSIDL_GET_MSG_TYPE_SUPPORT(std_msgs, msg, UInt64);
        of_subscription.qos.reliability = RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
        need(rcl_subscription_init(&flooded, &node, number, "flood", &of_subscription));
        need(rcl_subscription_set_on_new_message_callback(&flooded, rung, &flood_bell));
        pthread_t thread;
        if (pthread_create(&thread, NULL, take_flood, NULL))
            return 1;
    }
    return pings ? ping() : echo();
}
