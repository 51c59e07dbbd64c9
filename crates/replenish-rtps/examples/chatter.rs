//! A ROS 2 node without an agent, a thread or a ROS installation.
//!
//! ```text
//! cargo run -p replenish-rtps --example chatter -- talk 100      # 100 times Int32 on /chatter
//! cargo run -p replenish-rtps --example chatter -- listen 100    # ends after 100 of them
//! ```
//!
//! `ROS_DOMAIN_ID` chooses the domain. Only programs on this host are reached.

use replenish_rtps::participant::{EndpointSpec, Event};
use replenish_rtps::ros::{
    GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, GidSize, Node, Prefix, dds_topic, dds_type, encode_graph,
};
use replenish_rtps::udp::{UdpConfig, UdpParticipant};
use replenish_rtps::wire::{CDR_LE, Encapsulated, EntityId, Qos, TypeHash};
use std::error::Error;
use std::time::{Duration, Instant};

/// RIHS01 of `std_msgs/msg/Int32`.
const INT32: [u8; 32] = [
    0xb6, 0x57, 0x8d, 0xed, 0x3c, 0x58, 0xc6, 0x26, 0xcf, 0xe8, 0xd1, 0xa6, 0xfb, 0x6e, 0x04, 0xf7,
    0x06, 0xf9, 0x7e, 0x9f, 0x03, 0xd2, 0x72, 0x7c, 0x9f, 0xf4, 0xe7, 0x4b, 0x1c, 0xef, 0x0d, 0xeb,
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let role = args.next().unwrap_or_default();
    let count: usize = args.next().map_or(Ok(100), |text| text.parse())?;
    let domain = std::env::var("ROS_DOMAIN_ID").map_or(Ok(0), |text| text.parse())?;
    let config = UdpConfig {
        domain,
        ..UdpConfig::default()
    };
    let mut node = UdpParticipant::open(&config)?;
    match role.as_str() {
        "talk" => talk(&mut node, count),
        "listen" => listen(&mut node, count),
        other => Err(format!("role = {other:?} is not allowed: talk or listen").into()),
    }
}

/// Says which node has which endpoints, for `ros2 node list` and `ros2 topic info -v`.
fn introduce(
    node: &mut UdpParticipant,
    name: &str,
    readers: &[EntityId],
    writers: &[EntityId],
) -> Result<(), Box<dyn Error>> {
    let spec = EndpointSpec {
        qos: GRAPH_QOS,
        ..EndpointSpec::new(GRAPH_TOPIC, GRAPH_TYPE)
    };
    let now = node.now();
    let participant = node.participant_mut();
    let writer = participant.create_writer(&spec, now)?;
    let node = Node {
        namespace: "/",
        name,
        readers,
        writers,
    };
    let mut buf = [0; 512];
    let graph = encode_graph(&mut buf, participant.prefix(), &[node], GidSize::Bytes16)?;
    participant.write(writer, graph, None, now)?;
    Ok(())
}

fn talk(node: &mut UdpParticipant, count: usize) -> Result<(), Box<dyn Error>> {
    let now = node.now();
    let (topic, kind) = names()?;
    let writer = node
        .participant_mut()
        .create_writer(&spec(&topic, &kind), now)?;
    introduce(node, "replenish_talker", &[], &[writer.entity()])?;
    let matched = |node: &UdpParticipant| {
        let writer = node.participant().writer(writer);
        writer.is_some_and(|writer| writer.matched() > 0)
    };
    wait(node, &matched)?;
    println!("matched");
    for number in 1..=count {
        let sample = [CDR_LE, i32::try_from(number)?.to_le_bytes()].concat();
        let now = node.now();
        node.participant_mut().write(writer, &sample, None, now)?;
        let pause = Instant::now();
        while pause.elapsed() < Duration::from_millis(10) {
            node.step(Duration::from_millis(10).saturating_sub(pause.elapsed()))?;
        }
    }
    let acknowledged = |node: &UdpParticipant| {
        let writer = node.participant().writer(writer);
        writer.is_some_and(replenish_rtps::endpoint::Writer::is_acknowledged)
    };
    wait(node, &acknowledged)?;
    println!("sent {count}");
    Ok(())
}

fn listen(node: &mut UdpParticipant, count: usize) -> Result<(), Box<dyn Error>> {
    let now = node.now();
    let (topic, kind) = names()?;
    let reader = node
        .participant_mut()
        .create_reader(&spec(&topic, &kind), now)?;
    introduce(node, "replenish_listener", &[reader.entity()], &[])?;
    let (mut numbers, begin) = (Vec::new(), Instant::now());
    while numbers.len() < count && begin.elapsed() < Duration::from_secs(60) {
        node.step(Duration::from_millis(100))?;
        while let Some(sample) = node.participant_mut().take(reader) {
            numbers.push(Encapsulated::decode(sample.payload)?.reader().i32()?);
        }
        while let Some(event) = node.participant_mut().event() {
            if let Event::Matched(..) | Event::Incompatible(..) | Event::Full(_) = event {
                eprintln!("{event:?}");
            }
        }
    }
    println!("received {} {numbers:?}", numbers.len());
    // The last acknowledgement leaves before the goodbye.
    node.step(Duration::from_millis(50))?;
    Ok(())
}

fn names() -> Result<(String, String), &'static str> {
    let topic = dds_topic(Prefix::Topic, "/chatter").ok_or("the topic's name is too long")?;
    let kind = dds_type("std_msgs/msg/Int32").ok_or("the type's name is too long")?;
    Ok((topic.as_str().to_owned(), kind.as_str().to_owned()))
}

fn spec<'a>(topic: &'a str, kind: &'a str) -> EndpointSpec<'a> {
    EndpointSpec {
        type_hash: Some(TypeHash(INT32)),
        qos: Qos::ros(),
        sample_bytes: 64,
        ..EndpointSpec::new(topic, kind)
    }
}

/// Serves the participant until `done`, for a minute at most.
fn wait(
    node: &mut UdpParticipant,
    done: &dyn Fn(&UdpParticipant) -> bool,
) -> Result<(), Box<dyn Error>> {
    let begin = Instant::now();
    while !done(node) {
        if begin.elapsed() > Duration::from_secs(60) {
            return Err("no answer within a minute".into());
        }
        node.step(Duration::from_millis(100))?;
    }
    Ok(())
}
