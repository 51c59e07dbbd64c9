//! The bridge's DDS with a program of another library, ros2-client on RustDDS: topics and services
//! in both directions, and what it learns of our nodes.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

#[path = "../../crates/replenish-agent/tests/support/program.rs"]
mod program;

use program::{Program, domain};
use replenish_agent::dds::{Endpoint, EndpointKind, Node, Outgoing, Qos, RequestId, Topic};
use ros2_client::entities_info::ParticipantEntitiesInfo;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Client, Context, Message, MessageTypeName, Name, NodeName, NodeOptions, Publisher, QosProfile,
    Server, ServiceMapping, ServiceTypeName, Subscription,
};
use rustdds::policy;
use rustdds::{DomainParticipantBuilder, Duration as DdsDuration, QosPolicyBuilder, TopicKind};
use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use std::time::{Duration, Instant};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Int32 {
    data: i32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Request {
    a: i64,
    b: i64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Response {
    sum: i64,
}

impl Message for Int32 {}
impl Message for Request {}
impl Message for Response {}

fn context(domain: u16) -> Context {
    let loopback = [std::net::Ipv4Addr::LOCALHOST];
    let builder = DomainParticipantBuilder::new(domain).with_only_networks(loopback);
    Context::from_domain_participant(builder.build().unwrap()).unwrap()
}

fn node(context: &Context) -> ros2_client::Node {
    let name = NodeName::new("/", "peer").unwrap();
    context.new_node(name, NodeOptions::new()).unwrap()
}

fn reliable() -> QosProfile {
    QosProfile::subscription_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 100 })
}

/// Asks again and again.
fn eventually<T: Debug>(mut ask: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + Duration::from_secs(30);
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(Instant::now() < deadline, "in vain");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn topics_in_both_directions() {
    for qos in [reliable(), reliable().reliability_best_effort()] {
        let domain = domain();
        let context = context(domain);
        let mut node = node(&context);
        let topic = |name| {
            let name = Name::new("/", name).unwrap();
            let kind = MessageTypeName::new("std_msgs", "Int32");
            node.create_topic(&name, kind, &qos).unwrap()
        };
        let (up, down) = (topic("up"), topic("down"));
        let heard: Subscription<Int32> = node.create_subscription(&up, None).unwrap();
        let said: Publisher<Int32> = node.create_publisher(&down, None).unwrap();
        let mut program = Program::new(domain);
        let ours = Qos {
            reliable: qos != reliable().reliability_best_effort(),
            ..Qos::default()
        };
        let int32 = |name| Topic::new(name, "std_msgs::msg::dds_::Int32_");
        let writer = program.writer(&int32("rt/up"), ours);
        let reader = program.reader(&int32("rt/down"), ours);
        program.matched(writer, 1);
        program.matched(reader, 1);
        // Nothing says when the other side has found our reader.
        eventually(|| {
            said.publish(Int32 { data: -1 }).unwrap();
            program.within(reader, Duration::from_millis(20))
        });
        while program.within(reader, Duration::from_millis(100)).is_some() {}
        for data in 0..100_i32 {
            program.write(writer, &data.to_le_bytes());
            let (got, _) = eventually(|| heard.take().unwrap());
            assert_eq!(got, Int32 { data });
            said.publish(Int32 { data }).unwrap();
            assert_eq!(program.next(reader).payload, data.to_le_bytes());
        }
    }
}

#[test]
fn services_in_both_directions() {
    for mapping in [ServiceMapping::Enhanced, ServiceMapping::Cyclone] {
        let domain = domain();
        let context = context(domain);
        let mut node = node(&context);
        // Its own vendor id does not tell that it speaks Cyclone's form; so ours is told.
        let config = replenish_agent::dds::DdsConfig {
            services: match mapping {
                ServiceMapping::Cyclone => replenish_agent::dds::ServiceMapping::Cyclone,
                _ => replenish_agent::dds::ServiceMapping::Auto,
            },
            ..replenish_agent::dds::DdsConfig::default()
        };
        let mut program = Program::with(domain, &config);
        let kind = ServiceTypeName::new("example_interfaces", "AddTwoInts");
        let topics = |name: &str| {
            let kind = "example_interfaces::srv::dds_::AddTwoInts";
            let request = Topic::new(format!("rq/{name}Request"), format!("{kind}_Request_"));
            let reply = Topic::new(format!("rr/{name}Reply"), format!("{kind}_Response_"));
            (request, reply)
        };

        let name = Name::new("/", "theirs").unwrap();
        let server: Server<Request, Response> = node
            .create_server(mapping, &name, &kind, reliable(), reliable())
            .unwrap();
        let (request, reply) = topics("theirs");
        let requester = program.open(EndpointKind::Requester { request, reply });
        for i in 0..20_i64 {
            let id = RequestId {
                guid: [5; 16],
                sequence: i,
            };
            let payload = [i.to_le_bytes(), 100_i64.to_le_bytes()].concat();
            program.dds.write(requester, Outgoing::call(id, payload));
            let (theirs, Request { a, b }) = eventually(|| server.receive_request().unwrap());
            server
                .send_response(theirs, Response { sum: a + b })
                .unwrap();
            let got = program.next(requester);
            assert_eq!(got.request, Some(id));
            assert_eq!(got.payload, (i + 100).to_le_bytes());
        }

        let name = Name::new("/", "ours").unwrap();
        let client: Client<Request, Response> = node
            .create_client(mapping, &name, &kind, reliable(), reliable())
            .unwrap();
        let (request, reply) = topics("ours");
        let replier = program.open(EndpointKind::Replier { request, reply });
        program.matched(replier, 2);
        std::thread::sleep(Duration::from_millis(200)); // and be found
        for a in 0..20_i64 {
            let asked = client.send_request(Request { a, b: 7 }).unwrap();
            let got = program.next(replier);
            assert_eq!(got.payload, [a.to_le_bytes(), 7_i64.to_le_bytes()].concat());
            let sum = (a + 7).to_le_bytes().to_vec();
            let answer = Outgoing::call(got.request.unwrap(), sum);
            program.dds.write(replier, answer);
            let (id, Response { sum }) = eventually(|| client.receive_response().unwrap());
            assert_eq!((id, sum), (asked, a + 7));
        }
    }
}

/// The graph information behind `ros2 node list` and `ros2 node info`.
#[test]
fn nodes_are_announced_with_what_is_theirs() {
    let domain = domain();
    let context = context(domain);
    let participant = context.domain_participant();
    let qos = QosPolicyBuilder::new()
        .reliable(DdsDuration::from_millis(100))
        .durability(policy::Durability::TransientLocal)
        .history(policy::History::KeepLast { depth: 1 })
        .build();
    let type_name = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
    let topic = participant.create_topic(
        "ros_discovery_info".into(),
        type_name.into(),
        &qos,
        TopicKind::NoKey,
    );
    let subscriber = participant.create_subscriber(&qos).unwrap();
    let mut reader = subscriber
        .create_datareader_no_key_cdr::<ParticipantEntitiesInfo>(&topic.unwrap(), None)
        .unwrap();
    let mut next = |nodes: usize, readers: usize, writers: usize| {
        eventually(|| {
            let sample = reader.take_next_sample().unwrap()?;
            let info = sample.into_value();
            let text = format!("{info:?}");
            let count = |field: &str| -> usize {
                let lists = text.split(field).skip(1);
                let list = lists.map(|rest| rest.split_once(']').unwrap().0);
                list.map(|list| list.split([',', '[']).filter(|gid| gid.len() > 16).count())
                    .sum()
            };
            let found = (
                info.nodes().len(),
                count("reader_gid_seq"),
                count("writer_gid_seq"),
            );
            (found == (nodes, readers, writers)).then_some(info)
        })
    };
    let program = Program::new(domain);
    let info = |name: &str| Node {
        domain,
        name: name.into(),
    };
    program.dds.open_node(1, info("mcu/left")).unwrap();
    program.dds.open_node(2, info("right")).unwrap();
    let (request, reply) = (
        Topic::new("rq/aRequest", "A_"),
        Topic::new("rr/aReply", "B_"),
    );
    let endpoint = Endpoint {
        domain,
        node: Some(1),
        kind: EndpointKind::Replier { request, reply },
    };
    program.dds.open(3, endpoint).unwrap();
    let info = next(2, 1, 1);
    let mut names: Vec<String> = info
        .nodes()
        .iter()
        .map(ros2_client::entities_info::NodeEntitiesInfo::fully_qualified_name)
        .collect();
    names.sort();
    assert_eq!(names, ["/mcu/left", "/right"]);
    program.dds.close(3);
    program.dds.close(2);
    let info = next(1, 0, 0);
    assert_eq!(info.nodes()[0].fully_qualified_name(), "/mcu/left");
}
