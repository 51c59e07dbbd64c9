// eProsima Fast DDS 2.9 (Debian's) in peer.py's place, as rmw_fastrtps of Humble writes to the network.
//
// fastdds topics N   as peer.py does
// fastdds client N   asks /peer/add N times
// fastdds serve      serves /peer/add; runs until it is killed

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/common/WriteParams.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using eprosima::fastrtps::rtps::WriteParams;

// All types of this program are a few integers in a row, whose CDR is their memory.
template <class T> struct Plain : TopicDataType {
    explicit Plain(const char *name) {
        setName(name);
        m_typeSize = sizeof(T) + 4;
        m_isGetKeyDefined = false;
    }
    bool serialize(void *data, SerializedPayload_t *payload) override {
        const unsigned char head[4] = {0, 1, 0, 0};
        std::memcpy(payload->data, head, 4);
        std::memcpy(payload->data + 4, data, sizeof(T));
        payload->length = m_typeSize;
        payload->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(SerializedPayload_t *payload, void *data) override {
        if (payload->length < m_typeSize || payload->data[1] != 1)
            return false;
        std::memcpy(data, payload->data + 4, sizeof(T));
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void *) override {
        return [this] { return m_typeSize; };
    }
    void *createData() override { return new T(); }
    void deleteData(void *data) override { delete static_cast<T *>(data); }
    bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

struct Int32 { int32_t data; };
struct Request { int64_t a, b; };
struct Response { int64_t sum; };

static DomainParticipant *participant;
static Publisher *publisher;
static Subscriber *subscriber;

static void sleep_ms(int ms) { std::this_thread::sleep_for(std::chrono::milliseconds(ms)); }
static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <class T> static Topic *topic(const std::string &name, const char *type) {
    TypeSupport(new Plain<T>(type)).register_type(participant);
    return participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
}

template <class Q> static Q how(Q qos, bool reliable) {
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 500;
    return qos;
}

template <class T> static DataWriter *writer(const std::string &name, const char *type, bool reliable = true) {
    return publisher->create_datawriter(topic<T>(name, type), how(DATAWRITER_QOS_DEFAULT, reliable));
}

template <class T> static DataReader *reader(const std::string &name, const char *type, bool reliable = true) {
    return subscriber->create_datareader(topic<T>(name, type), how(DATAREADER_QOS_DEFAULT, reliable));
}

template <class T> static bool next(DataReader *reader, T &sample, SampleInfo &info) {
    while (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK)
        if (info.valid_data)
            return true;
    return false;
}

// Where the network loses some, a late zero, by which both got to know each other, may come until the
// numbers begin.
static size_t numbers(DataReader *reader, std::vector<int> &seen, bool begun = true) {
    Int32 sample;
    SampleInfo info;
    size_t before = seen.size();
    while (next(reader, sample, info))
        if (sample.data || !seen.empty() || !begun)
            seen.push_back(sample.data);
    return seen.size() - before;
}

static void topics(int count) {
    const char *type = "std_msgs::msg::dds_::Int32_";
    for (bool reliable : {true, false}) {
        std::string kind = reliable ? "reliable" : "best_effort";
        DataWriter *out = writer<Int32>("rt/peer/" + kind + "_to_ours", type, reliable);
        DataReader *back = reader<Int32>("rt/peer/" + kind + "_from_ours", type, reliable);
        std::vector<int> seen;
        Int32 sample{0};
        // Both sides know each other once something has come back; then until nothing more comes.
        while (numbers(back, seen, false) == 0) {
            out->write(&sample);
            sleep_ms(100);
        }
        for (double quiet = now(); now() - quiet < 1; sleep_ms(10))
            quiet = numbers(back, seen, false) ? now() : quiet;
        seen.clear();
        for (sample.data = 1; sample.data <= count; sample.data++) {
            out->write(&sample);
            sleep_ms(2);
            numbers(back, seen);
        }
        for (double begin = now(); seen.size() < size_t(count) && now() - begin < 50; sleep_ms(10))
            numbers(back, seen);
        sleep_ms(500);
        numbers(back, seen);
        bool right = seen.size() == size_t(count);
        for (size_t at = 0; at < seen.size(); at++)
            right = right && seen[at] == int(at) + 1;
        std::printf("%s %zu %s\n", kind.c_str(), seen.size(), right ? "True" : "False");
    }
}

static const char *REQUEST = "example_interfaces::srv::dds_::AddTwoInts_Request_";
static const char *RESPONSE = "example_interfaces::srv::dds_::AddTwoInts_Response_";

static void client(int count) {
    DataReader *answers = reader<Response>("rr/peer/addReply", RESPONSE);
    DataWriter *asks = writer<Request>("rq/peer/addRequest", REQUEST);
    PublicationMatchedStatus asked;
    SubscriptionMatchedStatus answered;
    do {
        sleep_ms(10);
        asks->get_publication_matched_status(asked);
        answers->get_subscription_matched_status(answered);
    } while (asked.current_count == 0 || answered.current_count == 0);
    // The server may see the reader of replies a little later than the writer of requests.
    sleep_ms(500);
    int right = 0;
    for (int64_t number = 1; number <= count; number++) {
        Request request{number, 1000};
        Response response{0};
        SampleInfo info;
        // As rmw_fastrtps does: the reader that waits for the reply, and a number still unknown.
        WriteParams wparams;
        wparams.related_sample_identity().writer_guid(answers->guid());
        asks->write(&request, wparams);
        for (double begin = now(); now() - begin < 50; sleep_ms(1)) {
            if (!next(answers, response, info))
                continue;
            auto &to = info.related_sample_identity;
            right += response.sum == number + 1000 && to.writer_guid() == answers->guid() &&
                     to.sequence_number() == wparams.sample_identity().sequence_number();
            break;
        }
    }
    std::printf("answered %d\n", right);
}

static void serve() {
    DataReader *asked = reader<Request>("rq/peer/addRequest", REQUEST);
    DataWriter *answers = writer<Response>("rr/peer/addReply", RESPONSE);
    std::puts("ready");
    for (;; sleep_ms(1)) {
        Request request;
        SampleInfo info;
        while (next(asked, request, info)) {
            Response response{request.a + request.b};
            // The client's reader if it names one, otherwise its writer; the number is the request's.
            WriteParams wparams;
            auto &to = wparams.related_sample_identity();
            to.writer_guid() = info.sample_identity.writer_guid();
            to.sequence_number() = info.sample_identity.sequence_number();
            if (info.related_sample_identity.writer_guid() != eprosima::fastrtps::rtps::GUID_t::unknown())
                to.writer_guid() = info.related_sample_identity.writer_guid();
            answers->write(&response, wparams);
        }
    }
}

int main(int count, char **words) {
    setvbuf(stdout, nullptr, _IOLBF, 0);
    const char *domain = std::getenv("ROS_DOMAIN_ID");
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    const char *address = std::getenv("REPLENISH_PEER_ADDRESS");
    udp->interfaceWhiteList.push_back(address ? address : "127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    eprosima::fastrtps::rtps::Locator_t local;
    eprosima::fastrtps::rtps::IPLocator::setIPv4(local, 127, 0, 0, 1);
    // Loopback has no multicast.
    if (!address)
        qos.wire_protocol().builtin.initialPeersList.push_back(local);
    participant = DomainParticipantFactory::get_instance()->create_participant(domain ? std::atoi(domain) : 0, qos);
    publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    std::string mode = count > 1 ? words[1] : "";
    if (mode == "topics" && count == 3)
        topics(std::atoi(words[2]));
    else if (mode == "client" && count == 3)
        client(std::atoi(words[2]));
    else if (mode == "serve")
        serve();
    else
        return 2;
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
}
