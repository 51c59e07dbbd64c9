//! [`Asked`]: when a reader may ask a writer again for what it lacks.
//!
//! ```text
//!   heartbeat: a sample is missing     ──► asked for at once
//!   heartbeat: a fragment is missing   ──► asked for at once, or 10 ms after the last such request;
//!   it is the same fragment as then    ──► after 10, 20, 40, 80, 80 ms, and for half as many
//!                                          fragments each time
//! ```
//!
//! A writer of Fast DDS sends a heartbeat with each repair. If each of them were answered with
//! everything that is missing, what is still on its way would be sent again and again, until the
//! link carries nothing else. Fewer fragments, since it sends those of 64 kB, each of which is 45
//! frames of Ethernet: none may arrive whole if many are under way.

use crate::wire::{Nanos, SequenceNumber};

/// The time from a request to the next one, at first.
const FIRST_WAIT: Nanos = 10_000_000;
/// How often that time doubles.
const DOUBLINGS: u8 = 3;

/// The last request to a writer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    /// The first sample that was missing, and its first fragment, from 1; 0 without fragments.
    first: (SequenceNumber, u32),
    at: Nanos,
    /// Fragments that are asked for at most, and those that were.
    pub(super) most: u16,
    pub(super) fragments: u16,
    /// The requests before it for the same.
    times: u8,
}

impl Asked {
    pub(super) const NOTHING: Asked = Asked {
        first: (0, 0),
        at: 0,
        most: 256,
        fragments: 0,
        times: 0,
    };

    /// A request for `first` and what follows goes out now.
    pub(super) fn note(&mut self, first: (SequenceNumber, u32), now: Nanos) {
        if self.first == first && first.1 > 0 {
            self.times = self.times.saturating_add(1).min(DOUBLINGS);
            self.most = (self.fragments / 2).max(1);
        } else {
            self.times = 0;
            self.most = self.most.saturating_mul(2).min(256);
        }
        (self.first, self.at) = (first, now);
    }

    /// The time of the next request, if `first` is the first sample that is missing.
    pub(super) fn again_at(&self, first: SequenceNumber) -> Nanos {
        match self.first {
            (_, 0) => 0,
            (last, _) if last == first => self.at.saturating_add(FIRST_WAIT << self.times),
            _ => self.at.saturating_add(FIRST_WAIT),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::endpoint::{Reader, ReaderLimits};
    use crate::wire::{
        DataFrag, EntityId, Guid, GuidPrefix, Heartbeat, Message, MessageWriter, Qos, Submessage,
    };
    use alloc::vec::Vec;
    use core::net::Ipv4Addr;

    const MILLI: Nanos = 1_000_000;
    const FRAGMENTS: u32 = 16;
    const SIZE: u16 = 8;

    struct Pair {
        reader: Reader,
        writer: Guid,
        count: u32,
    }

    impl Pair {
        fn new() -> Self {
            let limits = ReaderLimits {
                samples: 2,
                sample_bytes: 16_384,
                writers: 1,
            };
            let own = Guid::new(GuidPrefix([7; 12]), EntityId::reader(1));
            let writer = Guid::new(GuidPrefix([1; 12]), EntityId::writer(1));
            let mut reader = Reader::new(own, Qos::latched(2), &limits);
            let to = (Ipv4Addr::LOCALHOST, 1).into();
            reader.add_writer(writer, &Qos::latched(2), to);
            let count = 0;
            let mut pair = Pair {
                reader,
                writer,
                count,
            };
            pair.asks(0); // for a heartbeat
            pair
        }

        fn fragment(&mut self, sn: SequenceNumber, start: u32) {
            let body = DataFrag {
                reader: EntityId::UNKNOWN,
                writer: self.writer.entity,
                sn,
                start,
                count: 1,
                key: false,
                fragment_size: SIZE,
                sample_size: FRAGMENTS * u32::from(SIZE),
                inline_qos: None,
                payload: &[0; SIZE as usize],
            };
            self.reader.data_frag(self.writer.prefix, &body, None);
        }

        fn heartbeat(&mut self, last: SequenceNumber) {
            self.count += 1;
            let body = Heartbeat {
                reader: EntityId::UNKNOWN,
                writer: self.writer.entity,
                first: 1,
                last,
                count: self.count,
                final_flag: false,
                liveliness: false,
            };
            self.reader.heartbeat(self.writer.prefix, &body);
        }

        /// The samples and fragments that it asks for now, if it says something.
        fn asks(&mut self, now: Nanos) -> Option<(Vec<SequenceNumber>, Vec<u32>)> {
            if !self.reader.wants_to_transmit(now) {
                return None;
            }
            let (mut buf, mut asked) = ([0; 256], (Vec::new(), Vec::new()));
            let mut m = MessageWriter::new(&mut buf, GuidPrefix([7; 12])).unwrap();
            self.reader.transmit(now, &mut m).unwrap();
            for part in Message::decode(m.message()).unwrap().submessages() {
                match part.unwrap() {
                    Submessage::AckNack(body) => asked.0.extend(body.state.iter()),
                    Submessage::NackFrag(body) => asked.1.extend(body.state.iter()),
                    _ => {}
                }
            }
            Some(asked)
        }
    }

    #[test]
    fn what_does_not_come_is_asked_for_ever_more_rarely_and_in_smaller_parts() {
        let mut pair = Pair::new();
        pair.fragment(1, 3);
        let mut asked = Vec::new();
        for milli in 0..400 {
            pair.heartbeat(1);
            if let Some((samples, fragments)) = pair.asks(milli * MILLI) {
                assert_eq!(samples, []);
                assert_eq!(fragments.first(), Some(&1));
                asked.push((milli, fragments.len()));
            }
        }
        let rarely = [
            (0, 15),
            (10, 7),
            (30, 3),
            (70, 1),
            (150, 1),
            (230, 1),
            (310, 1),
            (390, 1),
        ];
        assert_eq!(asked, rarely);
        // The first of it comes: the next requests follow sooner, and are larger.
        pair.fragment(1, 1);
        pair.heartbeat(1);
        assert_eq!(pair.asks(469 * MILLI), None);
        assert_eq!(pair.asks(470 * MILLI), Some(([].into(), [2, 4].into())));
        pair.fragment(1, 2);
        pair.heartbeat(1);
        assert_eq!(pair.asks(479 * MILLI), None);
        assert_eq!(
            pair.asks(480 * MILLI),
            Some(([].into(), [4, 5, 6, 7].into()))
        );
    }

    #[test]
    fn a_lost_sample_is_asked_for_at_once() {
        let mut pair = Pair::new();
        for sn in 1..5 {
            let now = i64::unsigned_abs(sn) * 20 * MILLI;
            pair.heartbeat(sn);
            assert_eq!(pair.asks(now), Some(([sn].into(), [].into())));
            for fragment in 1..=FRAGMENTS {
                pair.fragment(sn, fragment);
            }
            // All is there: the heartbeat is answered at once, without a request.
            pair.heartbeat(sn);
            assert_eq!(pair.asks(now + MILLI), Some(([].into(), [].into())));
            assert!(pair.reader.take().is_some());
        }
    }

    #[test]
    fn a_sample_of_which_nothing_comes_is_asked_for_at_each_heartbeat() {
        let mut pair = Pair::new();
        for milli in 1..45 {
            pair.heartbeat(2);
            assert_eq!(pair.asks(milli * MILLI), Some(([1, 2].into(), [].into())));
        }
    }

    #[test]
    fn a_request_waits_for_its_time_also_beside_another_answer() {
        let mut pair = Pair::new();
        pair.fragment(1, 3);
        pair.heartbeat(1);
        assert!(pair.asks(MILLI).is_some());
        pair.heartbeat(1);
        let (mut buf, to) = ([0; 256], (Ipv4Addr::LOCALHOST, 1).into());
        let mut m = MessageWriter::new(&mut buf, GuidPrefix([7; 12])).unwrap();
        let before = m.message().len();
        let prefix = pair.writer.prefix;
        pair.reader.transmit_along(prefix, (to, 2 * MILLI), &mut m);
        assert_eq!(m.message().len(), before);
        pair.reader.transmit_along(prefix, (to, 11 * MILLI), &mut m);
        assert!(m.message().len() > before);
    }
}
