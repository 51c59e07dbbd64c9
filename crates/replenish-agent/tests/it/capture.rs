//! The agent's answers against those of eProsima's agents, byte for byte.
//!
//! The captured clients' messages are played to our agent, and its answers are compared with those
//! of the captured agent to the same client. Repetitions count once. Heartbeats are left out:
//! they depend on how slow an agent was. Of DATA, the sequence number is: the captured agents lose
//! the first samples while DDS finds out who reads them, ours does not.

use crate::common::{Datagram, scenario};
use replenish_agent::{AgentCore, Limits, Now};
use replenish_xrce::wire::{Body, Message, SubmessageId, WireTime};
use std::collections::BTreeSet;

type Sent = BTreeSet<(u16, Vec<u8>)>;

fn kind(bytes: &[u8]) -> SubmessageId {
    let message = Message::parse(bytes).unwrap();
    let mut submessages = message.submessages();
    let first = submessages.next().unwrap().unwrap();
    assert!(
        submessages.next().is_none(),
        "one submessage in each message"
    );
    first.id
}

fn insert(sent: &mut Sent, port: u16, bytes: &[u8]) {
    let mut bytes = bytes.to_vec();
    match kind(&bytes) {
        SubmessageId::Heartbeat => return,
        SubmessageId::Data => bytes[2..4].fill(0),
        _ => {}
    }
    sent.insert((port, bytes));
}

/// Our agent's messages when the scenario's clients are played to it.
fn play(datagrams: &[Datagram], unix: i64) -> Sent {
    let mut agent = AgentCore::new(Limits::default());
    let mut sent = Sent::new();
    for datagram in datagrams.iter().filter(|d| d.from_client) {
        let now = Now {
            monotonic: datagram.time,
            unix,
        };
        agent.receive(now, datagram.client_port, &datagram.bytes);
        while agent.pump(now, 100, &mut |port, bytes| insert(&mut sent, *port, bytes)) {}
    }
    assert_eq!(agent.stats().malformed, 0);
    sent
}

fn captured(datagrams: &[Datagram]) -> Sent {
    let mut sent = Sent::new();
    for datagram in datagrams.iter().filter(|d| !d.from_client) {
        insert(&mut sent, datagram.client_port, &datagram.bytes);
    }
    sent
}

/// For each captured datagram that ours does not send: which it is, and from what offset on the one
/// of ours for that client that is most like it differs.
fn missing(datagrams: &[Datagram], theirs: &Sent, ours: &Sent) -> Vec<String> {
    let explain = |(port, bytes): &(u16, Vec<u8>)| {
        let mut from_agent = datagrams.iter().filter(|datagram| !datagram.from_client);
        let is_it = |datagram: &&Datagram| {
            let mut alone = Sent::new();
            insert(&mut alone, datagram.client_port, &datagram.bytes);
            alone.contains(&(*port, bytes.clone()))
        };
        let which = from_agent.find(is_it).unwrap();
        let common = |other: &[u8]| bytes.iter().zip(other).take_while(|(a, b)| a == b).count();
        let candidates = ours.iter().filter(|(to, _)| to == port);
        let likest = candidates
            .map(|(_, bytes)| bytes)
            .max_by_key(|bytes| common(bytes));
        let (offset, made) = likest.map_or((0, &[][..]), |made| (common(made), made));
        format!("{which}, offset {offset:#x}: captured {bytes:02x?}, made {made:02x?}")
    };
    theirs.difference(ours).map(explain).collect()
}

/// Everything the captured agent sent, ours sends too; returns what it sends besides.
fn covers(datagrams: &[Datagram]) -> Vec<Vec<u8>> {
    let (theirs, ours) = (captured(datagrams), play(datagrams, 0));
    assert!(theirs.len() > 2, "{} captured datagrams", theirs.len());
    let missing = missing(datagrams, &theirs, &ours);
    assert!(missing.is_empty(), "{missing:#?}");
    ours.difference(&theirs)
        .map(|(_, bytes)| bytes.clone())
        .collect()
}

fn same(name: &str) {
    assert_eq!(
        covers(&scenario(name)),
        Vec::<Vec<u8>>::new(),
        "{name}: only ours"
    );
}

/// Only samples come besides, `count` of them.
fn same_but_for_lost_samples(datagrams: &[Datagram], count: usize) {
    let besides = covers(datagrams);
    assert!(
        besides
            .iter()
            .all(|bytes| kind(bytes) == SubmessageId::Data),
        "{besides:02x?}"
    );
    assert_eq!(besides.len(), count);
}

#[test]
fn best_effort_exchange() {
    same("besteffort");
}

#[test]
fn binary_entities_and_a_client_that_hears_itself() {
    same("binary");
}

#[test]
fn ping_in_and_outside_of_a_session() {
    same("tcp");
}

#[test]
fn reliable_exchange_with_xml_entities() {
    same_but_for_lost_samples(&scenario("reliable"), 1);
}

#[test]
fn reliable_exchange_as_with_agent_3() {
    same_but_for_lost_samples(&scenario("reliable, agent v3.0.1 (Fast DDS 3.2.3)"), 3);
}

/// The agent's side of a lossy proxy: what the clients' repetitions and NACKs make it repeat.
#[test]
fn repair_of_lost_messages() {
    let mut datagrams = scenario("loss");
    datagrams.retain(|d| [50924, 36287].contains(&d.client_port));
    same_but_for_lost_samples(&datagrams, 2);
}

/// The capture ends in the middle: the captured agent had not yet acknowledged the last four.
#[test]
fn fragments_are_acknowledged() {
    let besides = covers(&scenario("fragment (first 120 datagrams)"));
    assert!(
        besides
            .iter()
            .all(|bytes| kind(bytes) == SubmessageId::AckNack)
    );
    assert_eq!(besides.len(), 4);
}

#[test]
fn time_is_told() {
    let datagrams = scenario("timesync");
    let replies: Vec<&Datagram> = datagrams
        .iter()
        .filter(|d| kind(&d.bytes) == SubmessageId::TimestampReply)
        .collect();
    assert_eq!(replies.len(), 4);
    for reply in replies {
        let message = Message::parse(&reply.bytes).unwrap();
        let body = message
            .submessages()
            .next()
            .unwrap()
            .unwrap()
            .body()
            .unwrap();
        let Body::TimestampReply(times) = body else {
            panic!("{body:?}")
        };
        let nanos = times.receive.as_nanos();
        let ours = play(&datagrams, nanos);
        // Ours receives and transmits at once.
        let mut expected = reply.bytes.clone();
        expected.copy_within(16..24, 8);
        assert!(ours.contains(&(reply.client_port, expected)), "{reply}");
        assert_eq!(WireTime::from_nanos(nanos), times.receive);
    }
}

/// GUIDs are the agent's choice: zeros in what both agents send, and ours in what the captured
/// replier sends back.
#[test]
fn requests_and_replies() {
    let mut datagrams = scenario("reqrep");
    let theirs = datagrams
        .iter()
        .find_map(|d| guid(&d.bytes).filter(|_| !d.from_client))
        .unwrap();
    // The first request, as it arrives at the replier; no reply is needed for it.
    let ours = {
        let mut agent = AgentCore::new(Limits::default());
        let mut found = None;
        for d in datagrams.iter().filter(|d| d.from_client) {
            agent.receive(at(d.time), d.client_port, &d.bytes);
            while agent.pump(at(d.time), 100, &mut |_, bytes| {
                found = found.or(guid(bytes));
            }) {}
        }
        found.unwrap()
    };
    assert_eq!(ours[..2], theirs[..2], "the vendor");
    assert_ne!(ours, theirs);
    for datagram in &mut datagrams {
        let (old, new) = if datagram.from_client {
            (theirs, ours)
        } else {
            (theirs, [0; 16])
        };
        replace(&mut datagram.bytes, old, new);
    }
    let mut sent = Sent::new();
    for (port, mut bytes) in play(&datagrams, 0) {
        replace(&mut bytes, ours, [0; 16]);
        sent.insert((port, bytes));
    }
    let expected = captured(&datagrams);
    let missing = missing(&datagrams, &expected, &sent);
    assert!(missing.is_empty(), "{missing:#?}");
    // The captured requester was stopped before the last replies came.
    let besides: Vec<&(u16, Vec<u8>)> = sent.difference(&expected).collect();
    assert!(
        besides
            .iter()
            .all(|(port, bytes)| *port == 40493 || kind(bytes) == SubmessageId::AckNack),
        "{besides:02x?}"
    );
    let data = |sent: &Sent| {
        let all = sent.iter().filter(|(_, b)| kind(b) == SubmessageId::Data);
        all.count()
    };
    assert!(data(&expected) >= 8, "{}", data(&expected));
}

fn at(monotonic: u64) -> Now {
    Now { monotonic, unix: 0 }
}

/// The GUID in DATA for a replier.
fn guid(bytes: &[u8]) -> Option<[u8; 16]> {
    let message = Message::parse(bytes).unwrap();
    let first = message.submessages().next()?.unwrap();
    match first.body().unwrap() {
        Body::Data(data) if data.base.object.to_bytes()[1] & 15 == 8 => {
            data.payload.first_chunk().copied()
        }
        _ => None,
    }
}

fn replace(bytes: &mut [u8], old: [u8; 16], new: [u8; 16]) {
    for at in 0..bytes.len().saturating_sub(15) {
        if bytes[at..at + 16] == old {
            bytes[at..at + 16].copy_from_slice(&new);
        }
    }
}

/// Every datagram of the capture takes part in a test of this file: all scenarios, whole, but for
/// the clients' side of the lossy proxy, which the agent did not see.
#[test]
fn nothing_is_left_out() {
    let played = [
        "reliable",
        "besteffort",
        "binary",
        "loss",
        "timesync",
        "reqrep",
        "tcp",
        "fragment (first 120 datagrams)",
        "reliable, agent v3.0.1 (Fast DDS 3.2.3)",
    ];
    let all: BTreeSet<String> = crate::common::capture()
        .into_iter()
        .map(|d| d.scenario)
        .collect();
    assert_eq!(all, played.map(String::from).into());
}

/// A difference is named by scenario, number and offset.
#[test]
fn a_difference_is_named() {
    let datagrams = scenario("binary");
    let theirs = captured(&datagrams);
    let mut ours = theirs.clone();
    let (port, bytes) = theirs
        .iter()
        .find(|(_, b)| kind(b) == SubmessageId::Status)
        .unwrap();
    ours.remove(&(*port, bytes.clone()));
    let mut other = bytes.clone();
    *other.last_mut().unwrap() = 0x55;
    ours.insert((*port, other));
    let missing = missing(&datagrams, &theirs, &ours);
    let last = bytes.len() - 1;
    assert_eq!(missing.len(), 1);
    assert!(missing[0].starts_with("scenario binary, #"), "{missing:?}");
    assert!(
        missing[0].contains(&format!(" A->C, offset {last:#x}: ")),
        "{missing:?}"
    );
}
