//! Requests and replies of the bridge in both forms: the header of Cyclone's, the identity of the
//! enhanced one, and the table of requests until their replies.
#![no_main]
#![allow(dead_code, reason = "parts of a crate")]

#[path = "../../crates/replenish-agent/src/dds/calls.rs"]
mod calls;
#[path = "../../crates/replenish-agent/src/dds/header.rs"]
mod header;

use calls::Calls;
use header::{Header, Identity, LEN, enhanced, is_cyclone};
use libfuzzer_sys::fuzz_target;

/// Requests that a replier remembers.
const LIMIT: usize = 8;

fuzz_target!(|bytes: &[u8]| {
    let mut replier = Replier::default();
    let mut rest = bytes;
    while let [kind, len, after @ ..] = rest {
        let (sample, after) = after.split_at(usize::from(*len).min(after.len()));
        rest = after;
        match kind % 3 {
            0 => replier.cyclone(sample),
            1 => replier.enhanced(sample),
            _ => replier.reply(sample),
        }
    }
});

struct Replier {
    calls: Calls<Identity, bool>,
    /// The same, plainly: the oldest first.
    model: Vec<(Identity, bool)>,
}

impl Default for Replier {
    fn default() -> Self {
        Self {
            calls: Calls::new(LIMIT),
            model: Vec::new(),
        }
    }
}

impl Replier {
    /// A request of Cyclone's form: 16 bytes are the header, or it is none.
    fn cyclone(&mut self, sample: &[u8]) {
        let mut payload = sample.to_vec();
        let Some(header) = Header::split(&mut payload) else {
            assert!(sample.len() < LEN && payload == sample);
            return;
        };
        assert_eq!(payload, sample[LEN..]);
        assert_eq!(header.before(&payload), sample, "there and back");
        let mut guid = [1; 16];
        guid[8..].copy_from_slice(&header.client);
        self.asked((guid, header.sequence), true);
    }

    /// A request of the enhanced form: who writes it, and perhaps whom to answer.
    fn enhanced(&mut self, sample: &[u8]) {
        let mut numbers = sample.chunks_exact(24).map(|bytes| {
            let (guid, number) = bytes.split_at(16);
            let number = i64::from_le_bytes(number.try_into().unwrap());
            (<[u8; 16]>::try_from(guid).unwrap(), number)
        });
        let Some(own) = numbers.next() else {
            return;
        };
        let related = numbers.next();
        let to = enhanced(own, related);
        match related {
            Some((guid, number)) if guid != [0; 16] => {
                assert_eq!(to.0, guid);
                assert_eq!(to.1, if number > 0 { number } else { own.1 });
            }
            _ => assert_eq!(to, own),
        }
        assert_eq!(is_cyclone(&own.0), own.0[..2] == [1, 0x10]);
        self.asked(to, false);
    }

    fn asked(&mut self, identity: Identity, cyclone: bool) {
        let forgotten = self.calls.add(identity, cyclone);
        assert_eq!(forgotten, self.model.len() == LIMIT);
        if forgotten {
            self.model.remove(0);
        }
        self.model.push((identity, cyclone));
    }

    /// A reply to a request, or to none: in the form of the request, and once.
    fn reply(&mut self, sample: &[u8]) {
        let at = usize::from(sample.first().copied().unwrap_or(0));
        let to = self.model.get(at).map_or(([9; 16], 0), |(to, _)| *to);
        let expected = self.model.iter().position(|(known, _)| *known == to);
        let form = expected.map(|at| self.model.remove(at).1);
        assert_eq!(self.calls.get(&to).copied(), form);
        assert_eq!(self.calls.take(&to), form);
        if form == Some(true) {
            let header = Header {
                client: to.0[8..].try_into().unwrap(),
                sequence: to.1,
            };
            let mut reply = header.before(sample);
            assert_eq!(Header::split(&mut reply), Some(header));
            assert_eq!(reply, sample);
        }
    }
}
