//! Odd things that eProsima's client 3.0.1 does, seen when it was run against this agent
//! (`docs/peers.md`), in bytes of our own.

use crate::support::{Client, Got, World, data};
use replenish_agent::Limits;
use replenish_xrce::wire::{DeliveryControl, SessionId, Status, StreamId};

const KEY: [u8; 4] = [7; 4];

/// A message of a session with the key in its header, on the reliable stream.
fn keyed(seq: u16, body: &[u8]) -> Vec<u8> {
    let seq = seq.to_le_bytes();
    [&[0x01, 0x80, seq[0], seq[1]], &KEY[..], body].concat()
}

fn fragment(flags: u8, announced: u16, piece: &[u8]) -> Vec<u8> {
    [&[13, flags], &announced.to_le_bytes()[..], piece].concat()
}

/// With the key in the header, its last fragment is four bytes shorter than it says, which costs
/// the sample. That is counted, and everything after it is served.
#[test]
fn a_last_fragment_that_is_shorter_than_it_says() {
    let mut world = World::new(Limits::default());
    let mut client = Client::new(1, 7);
    client.session = SessionId(0x01);
    assert_eq!(client.login(&mut world), [Got::Agent(Status::OK)]);
    client.endpoint(&mut world, true, Some(4));
    client.read(
        &mut world,
        1,
        StreamId::RELIABLE,
        Some(DeliveryControl::UNLIMITED),
    );
    // WRITE_DATA of 12 bytes to data writer 1: participant, topic, publisher, subscriber, writer,
    // reader and READ_DATA came before.
    let write = [&[7, 1, 16, 0, 0, 30, 0, 0x15], &b"twelve bytes"[..]].concat();
    let (first, last) = write.split_at(12);
    let cut = &last[..last.len() - 4];
    world.deliver(1, &keyed(7, &fragment(1, 12, first)));
    world.deliver(1, &keyed(8, &fragment(3, 8, cut)));
    let got = client.got(&mut world);
    assert!(!got.contains(&data(1, b"twelve bytes")), "{got:?}");
    assert_eq!(world.agent.stats().malformed, 1);
    assert_eq!(got.last(), Some(&Got::Ack(replenish_xrce::SeqNum(9), 0)));

    // The next one is not put behind the pieces of the lost one.
    world.deliver(1, &keyed(9, &fragment(1, 12, first)));
    world.deliver(1, &keyed(10, &fragment(3, 8, last)));
    let got = client.got(&mut world);
    assert!(got.contains(&data(1, b"twelve bytes")), "{got:?}");
    assert_eq!(world.agent.stats().malformed, 1);
}

/// A fragment in the middle that cannot be read costs its sample up to the last fragment: what
/// follows it is not taken for the beginning of another.
#[test]
fn a_middle_fragment_that_is_shorter_than_it_says() {
    let mut world = World::new(Limits::default());
    let mut client = Client::new(1, 7);
    client.session = SessionId(0x01);
    assert_eq!(client.login(&mut world), [Got::Agent(Status::OK)]);
    client.endpoint(&mut world, true, Some(4));
    client.read(
        &mut world,
        1,
        StreamId::RELIABLE,
        Some(DeliveryControl::UNLIMITED),
    );
    // The last fragment is itself a whole WRITE_DATA, as a sample's content can be.
    let inside = [&[7, 1, 10, 0, 0, 30, 0, 0x15], &b"inside"[..]].concat();
    let first = [7, 1, 30, 0, 0, 30, 0, 0x15];
    world.deliver(1, &keyed(7, &fragment(1, 8, &first)));
    world.deliver(1, &keyed(8, &fragment(1, 12, b"short")));
    world.deliver(1, &keyed(9, &fragment(3, 14, &inside)));
    let got = client.got(&mut world);
    assert!(!got.contains(&data(1, b"inside")), "{got:?}");
    assert_eq!(world.agent.stats().malformed, 1);
    let write = [&[7, 1, 9, 0, 0, 30, 0, 0x15], &b"after"[..]].concat();
    world.deliver(1, &keyed(10, &write));
    assert!(client.got(&mut world).contains(&data(1, b"after")));
}
