// Eclipse Cyclone DDS 0.10 (Debian's) in peer.py's place, as rmw_cyclonedds writes to the network.
//
// cyclone topics N   as peer.py does
// cyclone client N   asks /peer/add N times
// cyclone serve      serves /peer/add; runs until it is killed

#include "types.h"
#include <dds/dds.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CLIENT 0x0102030405060708ULL
#define MOST 1000

static dds_entity_t participant;

static const char *configuration =
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"%s\"/></Interfaces>"
    "</General><Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address=\"%s\"/>"
    "</Peers></Discovery></Domain></CycloneDDS>";

static dds_entity_t made(dds_entity_t entity) {
    if (entity < 0) {
        fprintf(stderr, "%s\n", dds_strretcode(entity));
        exit(1);
    }
    return entity;
}

static dds_qos_t *qos(bool reliable) {
    dds_qos_t *qos = dds_create_qos();
    dds_reliability_kind_t kind = reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT;
    dds_qset_reliability(qos, kind, DDS_SECS(10));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 500);
    return qos;
}

static dds_entity_t end(bool reader, const char *name, const dds_topic_descriptor_t *type, bool reliable) {
    dds_entity_t topic = made(dds_create_topic(participant, type, name, NULL, NULL));
    dds_qos_t *how = qos(reliable);
    dds_entity_t made_end = reader ? dds_create_reader(participant, topic, how, NULL)
                                   : dds_create_writer(participant, topic, how, NULL);
    dds_delete_qos(how);
    return made(made_end);
}

static double now(void) { return dds_time() / 1e9; }

// Takes what there is, behind what was seen before; returns how many there are now. Where the network
// loses some, a late zero, by which both got to know each other, may come until the numbers begin.
static int numbers(dds_entity_t reader, int seen[MOST], int count, bool begun) {
    while (count < MOST) {
        void *sample = NULL;
        dds_sample_info_t info;
        if (dds_take(reader, &sample, &info, 1, 1) <= 0)
            break;
        int data = ((std_msgs_msg_dds__Int32_ *)sample)->data;
        if (info.valid_data && (data || count || !begun))
            seen[count++] = data;
        dds_return_loan(reader, &sample, 1);
    }
    return count;
}

static void topics(int count) {
    static int seen[MOST];
    for (int reliable = 1; reliable >= 0; reliable--) {
        const char *kind = reliable ? "reliable" : "best_effort";
        char to[64], from[64];
        snprintf(to, sizeof to, "rt/peer/%s_to_ours", kind);
        snprintf(from, sizeof from, "rt/peer/%s_from_ours", kind);
        dds_entity_t out = end(false, to, &std_msgs_msg_dds__Int32__desc, reliable);
        dds_entity_t back = end(true, from, &std_msgs_msg_dds__Int32__desc, reliable);
        std_msgs_msg_dds__Int32_ sample = {0};
        // Both sides know each other once something has come back; then until nothing more comes.
        while (numbers(back, seen, 0, false) == 0) {
            dds_write(out, &sample);
            dds_sleepfor(DDS_MSECS(100));
        }
        for (double quiet = now(); now() - quiet < 1; dds_sleepfor(DDS_MSECS(10)))
            quiet = numbers(back, seen, 0, false) ? now() : quiet;
        int got = 0;
        for (sample.data = 1; sample.data <= count; sample.data++) {
            dds_write(out, &sample);
            dds_sleepfor(DDS_MSECS(2));
            got = numbers(back, seen, got, true);
        }
        for (double begin = now(); got < count && now() - begin < 50; dds_sleepfor(DDS_MSECS(10)))
            got = numbers(back, seen, got, true);
        dds_sleepfor(DDS_MSECS(500));
        got = numbers(back, seen, got, true);
        bool right = got == count;
        for (int at = 0; at < got; at++)
            right = right && seen[at] == at + 1;
        printf("%s %d %s\n", kind, got, right ? "True" : "False");
    }
}

static const dds_topic_descriptor_t *request = &example_interfaces_srv_dds__AddTwoInts_Request__desc;
static const dds_topic_descriptor_t *response = &example_interfaces_srv_dds__AddTwoInts_Response__desc;

static void client(int count) {
    dds_entity_t answers = end(true, "rr/peer/addReply", response, true);
    dds_entity_t asks = end(false, "rq/peer/addRequest", request, true);
    dds_publication_matched_status_t asked = {0};
    dds_subscription_matched_status_t answered = {0};
    while (asked.current_count == 0 || answered.current_count == 0) {
        dds_get_publication_matched_status(asks, &asked);
        dds_get_subscription_matched_status(answers, &answered);
        dds_sleepfor(DDS_MSECS(10));
    }
    // The server may see the reader of replies a little later than the writer of requests.
    dds_sleepfor(DDS_MSECS(500));
    int right = 0;
    for (int64_t seq = 1; seq <= count; seq++) {
        example_interfaces_srv_dds__AddTwoInts_Request_ ask = {CLIENT, seq, seq, 1000};
        dds_write(asks, &ask);
        for (double begin = now(); now() - begin < 50; dds_sleepfor(DDS_MSECS(1))) {
            void *sample = NULL;
            dds_sample_info_t info;
            if (dds_take(answers, &sample, &info, 1, 1) <= 0)
                continue;
            example_interfaces_srv_dds__AddTwoInts_Response_ *got = sample;
            right += info.valid_data && got->guid == CLIENT && got->seq == seq && got->sum == seq + 1000;
            dds_return_loan(answers, &sample, 1);
            break;
        }
    }
    printf("answered %d\n", right);
}

static void serve(void) {
    dds_entity_t asked = end(true, "rq/peer/addRequest", request, true);
    dds_entity_t answers = end(false, "rr/peer/addReply", response, true);
    puts("ready");
    for (;; dds_sleepfor(DDS_MSECS(1))) {
        void *sample = NULL;
        dds_sample_info_t info;
        if (dds_take(asked, &sample, &info, 1, 1) <= 0)
            continue;
        example_interfaces_srv_dds__AddTwoInts_Request_ *ask = sample;
        example_interfaces_srv_dds__AddTwoInts_Response_ reply = {ask->guid, ask->seq, ask->a + ask->b};
        if (info.valid_data)
            dds_write(answers, &reply);
        dds_return_loan(asked, &sample, 1);
    }
}

int main(int count, char **words) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    const char *domain = getenv("ROS_DOMAIN_ID");
    dds_domainid_t number = domain ? (dds_domainid_t)atoi(domain) : 0;
    const char *given = getenv("REPLENISH_PEER_ADDRESS"), *address = given ? given : "127.0.0.1";
    char complete[1000];
    snprintf(complete, sizeof complete, configuration, address, address);
    made(dds_create_domain(number, complete));
    participant = made(dds_create_participant(number, NULL, NULL));
    if (count == 3 && !strcmp(words[1], "topics"))
        topics(atoi(words[2]));
    else if (count == 3 && !strcmp(words[1], "client"))
        client(atoi(words[2]));
    else if (count == 2 && !strcmp(words[1], "serve"))
        serve();
    else
        return 2;
    return dds_delete(participant) == 0 ? 0 : 1;
}
