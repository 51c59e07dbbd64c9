// One end of a round trip over Eclipse Cyclone DDS: a reliable reader on a waitset and a writer, on
// one thread beside those of Cyclone. cyclone ping | echo
#include "blob.h"
#include "round_trip.h"
#include <dds/dds.h>

static dds_entity_t reader, writer, waitset;
static uint8_t *buffer;
#define MOST (2u << 20)

static const char *configuration =
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>"
    "</General><Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address=\"127.0.0.1\"/>"
    "</Peers></Discovery></Domain></CycloneDDS>";

static dds_entity_t made(dds_entity_t entity) {
    if (entity < 0) {
        fprintf(stderr, "%s\n", dds_strretcode(entity));
        exit(1);
    }
    return entity;
}

static void transmit(uint64_t number, size_t bytes) {
    bench_msg_dds__Blob_ sample = {0};
    memcpy(buffer, &number, sizeof number);
    sample.data._buffer = buffer;
    sample.data._length = sample.data._maximum = (uint32_t)(bytes - 4);
    dds_write(writer, &sample);
}

static size_t receive(uint64_t *number, int64_t until) {
    for (;;) {
        void *sample = NULL;
        dds_sample_info_t info;
        if (dds_take(reader, &sample, &info, 1, 1) > 0) {
            size_t bytes = 0;
            bench_msg_dds__Blob_ *blob = sample;
            if (info.valid_data && blob->data._length >= 8) {
                memcpy(number, blob->data._buffer, 8);
                bytes = blob->data._length + 4u;
            }
            dds_return_loan(reader, &sample, 1);
            return bytes;
        }
        int64_t left = until - now_ns();
        if (left <= 0)
            return 0;
        dds_waitset_wait(waitset, NULL, 0, left);
    }
}

int main(int count, char **words) {
    if (count != 2)
        return 2;
    int pings = !strcmp(words[1], "ping");
    const char *domain = getenv("ROS_DOMAIN_ID");
    dds_domainid_t number = domain ? (dds_domainid_t)atoi(domain) : 0;
    buffer = calloc(1, MOST);
    if (!buffer)
        return 1;
    made(dds_create_domain(number, configuration));
    dds_entity_t participant = made(dds_create_participant(number, NULL, NULL));
    dds_qos_t *qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
    const dds_topic_descriptor_t *type = &bench_msg_dds__Blob__desc;
    dds_entity_t there = made(dds_create_topic(participant, type, "rt/there", NULL, NULL));
    dds_entity_t back = made(dds_create_topic(participant, type, "rt/back", NULL, NULL));
    writer = made(dds_create_writer(participant, pings ? there : back, qos, NULL));
    reader = made(dds_create_reader(participant, pings ? back : there, qos, NULL));
    waitset = made(dds_create_waitset(participant));
    dds_entity_t any = made(dds_create_readcondition(reader, DDS_ANY_STATE));
    made(dds_waitset_attach(waitset, any, 0));
    return pings ? ping() : echo();
}
