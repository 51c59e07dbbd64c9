//! A decoder of Perfetto's traces, which shares nothing with the encoder.

use std::collections::BTreeMap;

/// The fields of an encoded message.
fn fields(mut bytes: &[u8]) -> Vec<(u64, Field<'_>)> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let mut value = 0;
        for shift in (0..).step_by(7) {
            let (byte, rest) = bytes.split_first().unwrap();
            *bytes = rest;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return value;
            }
        }
        unreachable!()
    }
    let mut all = Vec::new();
    while !bytes.is_empty() {
        let tag = varint(&mut bytes);
        let field = match tag & 7 {
            0 => Field::Number(varint(&mut bytes)),
            1 => {
                let (number, rest) = bytes.split_first_chunk::<8>().unwrap();
                bytes = rest;
                Field::Number(u64::from_le_bytes(*number))
            }
            2 => {
                let length = usize::try_from(varint(&mut bytes)).unwrap();
                let (part, rest) = bytes.split_at(length);
                bytes = rest;
                Field::Bytes(part)
            }
            other => panic!("wire type {other}"),
        };
        all.push((tag >> 3, field));
    }
    all
}

#[derive(Clone, Copy)]
enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

fn number(fields: &[(u64, Field<'_>)], wanted: u64) -> Option<u64> {
    fields.iter().find_map(|(n, field)| match field {
        Field::Number(value) if *n == wanted => Some(*value),
        _ => None,
    })
}

fn part<'a>(fields: &[(u64, Field<'a>)], wanted: u64) -> Option<&'a [u8]> {
    fields.iter().find_map(|(n, field)| match field {
        Field::Bytes(value) if *n == wanted => Some(*value),
        _ => None,
    })
}

/// Reads a trace and checks it: a clock snapshot first, every event on a described track, slices
/// that nest, flows with both ends, a budget of 0 where it is exhausted. How many entries of each
/// type: slices' begins and ends, instants, values of counters, states.
pub(crate) fn check(trace: &[u8]) -> [usize; 5] {
    let packets = fields(trace);
    let (mut tracks, mut depth, mut counts) = (BTreeMap::new(), BTreeMap::new(), [0; 5]);
    let (mut from, mut to, mut exhausted, mut empty) = (vec![], vec![], vec![], vec![]);
    for (n, (field, packet)) in packets.iter().enumerate() {
        let Field::Bytes(packet) = packet else {
            panic!("packet {n}")
        };
        assert_eq!(*field, 1);
        let packet = fields(packet);
        let sequence = number(&packet, 10).unwrap();
        if n == 0 {
            assert_eq!(fields(part(&packet, 6).unwrap()).len(), 3, "three clocks");
        }
        if let Some(descriptor) = part(&packet, 60) {
            let uuid = number(&fields(descriptor), 1).unwrap();
            assert!(tracks.insert(sequence, uuid).is_none());
            assert_eq!(number(&packet, 13), Some(1));
        }
        let Some(event) = part(&packet, 11) else {
            continue;
        };
        assert!(tracks.contains_key(&sequence));
        let (time, event) = (number(&packet, 8).unwrap(), fields(event));
        let kind = usize::try_from(number(&event, 9).unwrap()).unwrap();
        counts[kind - 1] += 1;
        let depth: &mut i32 = depth.entry(sequence).or_default();
        *depth += match kind {
            1 => 1,
            2 => -1,
            _ => 0,
        };
        assert!(*depth >= 0, "a slice ends that has not begun");
        from.extend(number(&event, 47));
        to.extend(number(&event, 48));
        if part(&event, 23) == Some(b"exhausted") {
            exhausted.push(time);
        }
        if number(&event, 30) == Some(0) {
            empty.push(time);
        }
    }
    from.sort_unstable();
    from.dedup(); // a chain's flow goes through each of its stages
    to.sort_unstable();
    assert_eq!(from, to, "every flow has both ends");
    assert!(!from.is_empty() && !exhausted.is_empty());
    assert!(exhausted.iter().all(|time| empty.contains(time)));
    counts
}
