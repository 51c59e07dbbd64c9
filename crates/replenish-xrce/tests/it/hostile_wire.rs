//! Decoding of any bytes ends with a value or an error.
//!
//! A value that was decoded from any bytes can be encoded, and decoded again to the same value.

use std::sync::OnceLock;

use proptest::prelude::*;
use proptest::sample::Index;
use replenish_xrce::wire::{Body, Encode, Message, SubmessageId, Writer};

fn decode_everything(bytes: &[u8]) {
    if let Ok(message) = Message::parse(bytes) {
        let mut walked = 0;
        for submessage in message.submessages() {
            walked += 1;
            let Ok(submessage) = submessage else { continue };
            if let Ok(body) = submessage.body() {
                round_trip(submessage.id, &body);
            }
        }
        assert!(
            walked <= message.body.len() / 4 + 1,
            "the walk makes progress"
        );
    }
}

fn round_trip(id: SubmessageId, body: &Body<'_>) {
    let mut buf = vec![0; 70_000];
    let mut w = Writer::new(&mut buf);
    body.encode(&mut w).unwrap();
    let len = w.len();
    let flags = body.flags() | 1;
    let again = Body::decode(id, flags, &buf[..len]).unwrap();
    // Properties keep their encoded form and byte order, so compare their encodings.
    let mut second = vec![0; 70_000];
    let mut w = Writer::new(&mut second);
    again.encode(&mut w).unwrap();
    let second_len = w.len();
    assert_eq!(buf[..len], second[..second_len]);
    if !matches!(id, SubmessageId::CreateClient | SubmessageId::StatusAgent) {
        assert_eq!(*body, again);
    }
}

fn corpus() -> &'static [Vec<u8>] {
    static CORPUS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    CORPUS.get_or_init(|| {
        crate::common::capture()
            .into_iter()
            .map(|d| d.bytes)
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        decode_everything(&bytes);
    }

    #[test]
    fn random_bodies(id in 0_u8..16, flags in any::<u8>(), bytes in prop::collection::vec(any::<u8>(), 0..100)) {
        let id = SubmessageId::from_number(id).unwrap();
        if let Ok(body) = Body::decode(id, flags, &bytes) {
            round_trip(id, &body);
        }
    }

    #[test]
    fn mutated_datagrams(
        which in any::<Index>(),
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 0..6),
        cut in any::<Index>(),
        cut_it in any::<bool>(),
    ) {
        let mut bytes = which.get(corpus()).clone();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if cut_it {
            bytes.truncate(cut.index(bytes.len()));
        }
        decode_everything(&bytes);
    }
}
