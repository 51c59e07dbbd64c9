//! A reliable stream whose receiver may have no room: it stops, and goes on where it stopped.
//!
//! ```text
//!   receive_while ── delivered ──────────► next message
//!        │ refused
//!        ├─ its arrival was not reported: it counts as missing; the sender repeats it
//!        └─ its arrival was reported: it keeps its slot ── retry ──► next message
//! ```

use super::input_reliable::InputReliable;
use crate::SeqNum;
use crate::wire::Submessage;

impl<S, R, const N: usize> InputReliable<S, R, N>
where
    S: AsRef<[u8]> + AsMut<[u8]>,
    R: AsRef<[u8]> + AsMut<[u8]>,
{
    /// As [`receive`](Self::receive), for a receiver that may have no room: where `deliver` returns
    /// false, the stream stops before that submessage. The message counts as missing, and the
    /// sender repeats it, or it waits for [`retry`](Self::retry) if its arrival was reported
    /// before. Nothing is delivered twice.
    pub fn receive_while(
        &mut self,
        seq: SeqNum,
        body: &[u8],
        mut deliver: impl FnMut(&Submessage<'_>) -> bool,
    ) {
        self.receive_with::<true>(seq, body, &mut deliver);
    }

    /// Delivers what waits since [`receive_while`](Self::receive_while) stopped, as far as
    /// `deliver` takes it.
    pub fn retry(&mut self, mut deliver: impl FnMut(&Submessage<'_>) -> bool) {
        if self.kept & 1 != 0 {
            let stopped = self.place(self.slot(self.capacity.wrapping_sub(1)));
            self.go_on::<true>(stopped, &mut deliver);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{Fragment, StreamId, SubmessageId};
    use std::vec;
    use std::vec::Vec;

    type Input = InputReliable<Vec<u8>, Vec<u8>, 16>;

    fn input() -> Input {
        InputReliable::new(StreamId::RELIABLE, vec![0; 16 * 64], 64, vec![0; 256])
    }

    /// A message of submessages with these contents; `WRITE_DATA`, or fragments of one.
    fn message(id: SubmessageId, parts: &[(&[u8], u8)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (part, flags) in parts {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            bytes.extend([id as u8, *flags, part.len() as u8, 0]);
            bytes.extend(*part);
        }
        bytes
    }

    /// Takes `room` submessages of a message; what was taken.
    fn take(input: &mut Input, seq: u16, body: &[u8], room: &mut usize) -> Vec<Vec<u8>> {
        let mut got = Vec::new();
        input.receive_while(SeqNum(seq), body, |submessage| {
            let taken = *room > 0;
            if taken {
                *room = room.saturating_sub(1);
                got.push(submessage.payload.to_vec());
            }
            taken
        });
        got
    }

    #[test]
    fn a_receiver_without_room_stops_the_stream_and_gets_nothing_twice() {
        let mut input = input();
        let write = |parts: &[(&[u8], u8)]| message(SubmessageId::WriteData, parts);
        let three = write(&[(b"a", 1), (b"b", 1), (b"c", 1)]);
        let later = [write(&[(b"d", 1)]), write(&[(b"e", 1)])];
        // The messages after it wait for it.
        assert!(take(&mut input, 1, &later[0], &mut 9).is_empty());
        assert!(take(&mut input, 2, &later[1], &mut 9).is_empty());
        assert_eq!(take(&mut input, 0, &three, &mut 1), [b"a"]);
        let ack = input.take_ack().unwrap();
        assert_eq!((ack.first_unacked, ack.missing), (SeqNum(0), 0b001));
        assert_eq!(take(&mut input, 0, &three, &mut 1), [b"b"]);
        assert!(take(&mut input, 0, &three, &mut 0).is_empty());
        assert_eq!(take(&mut input, 0, &three, &mut 2), [b"c", b"d"]);
        // The sender knows that the last one has arrived: it will not come again.
        let ack = input.take_ack().unwrap();
        assert_eq!((ack.first_unacked, ack.missing), (SeqNum(2), 0));
        let mut got = Vec::new();
        for room in [false, true, true] {
            input.retry(|submessage| {
                got.extend(room.then(|| submessage.payload.to_vec()));
                room
            });
        }
        assert_eq!(got, [b"e"]);
        assert_eq!(input.next_expected(), SeqNum(3));
        assert_eq!(input.stats().received, 3);
    }

    #[test]
    fn what_was_not_taken_keeps_its_slot_while_more_arrives() {
        let mut input = input();
        let body = |seq: u16| message(SubmessageId::WriteData, &[(&seq.to_le_bytes(), 1)]);
        for seq in 1..16 {
            take(&mut input, seq, &body(seq), &mut 0);
        }
        assert_eq!(take(&mut input, 0, &body(0), &mut 1).len(), 1);
        // The second one waits in a slot that the seventeenth after it would take.
        for seq in 16..20 {
            take(&mut input, seq, &body(seq), &mut 0);
        }
        let mut got = Vec::new();
        input.retry(|submessage| {
            got.push(u16::from_le_bytes(submessage.payload.try_into().unwrap()));
            true
        });
        assert_eq!(got, (1..17).collect::<Vec<u16>>());
        assert_eq!(input.take_ack().unwrap().first_unacked, SeqNum(17));
    }

    #[cfg(feature = "fragments")]
    #[test]
    fn a_sample_in_fragments_that_is_not_taken_is_whole_when_its_end_comes_again() {
        let mut input = input();
        let whole = message(SubmessageId::WriteData, &[(b"0123456789", 1)]);
        let piece = |part: &[u8], last| {
            let flags = if last { 1 | Fragment::FLAG_LAST } else { 1 };
            message(SubmessageId::Fragment, &[(part, flags)])
        };
        let (first, last) = whole.split_at(8);
        assert!(take(&mut input, 0, &piece(first, false), &mut 0).is_empty());
        for _ in 0..3 {
            assert!(take(&mut input, 1, &piece(last, true), &mut 0).is_empty());
            assert_eq!(input.next_expected(), SeqNum(1));
        }
        assert_eq!(
            take(&mut input, 1, &piece(last, true), &mut 1),
            [b"0123456789"]
        );
        assert_eq!(input.next_expected(), SeqNum(2));
        assert_eq!(input.stats().malformed + input.stats().too_long, 0);
    }
}
