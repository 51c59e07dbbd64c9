//! Messages in memory: each reader of this process that takes their type gets the message itself.
//! The rest of the topic's readers get bytes, which its publisher writes once.
//!
//! ```text
//!   all take it ──────── lock: begin · share ─ unlock ─ ring the workers
//!   some do not ──────── nothing yet: "bytes are wanted" ──► the same with bytes, as a long sample
//! ```

use super::InProcess;
use super::bus::{Bus, Reader};
use crate::handoff::{Doorbell, SampleInfo, Shared};
use crate::middleware::{Middleware, PublishError, WriterId};
use crate::qos::Qos;
use crate::sync::Arc;
use replenish_os::clock;

/// Bells that are rung when the lock of the bus has been given back; more are rung under it.
const BELLS: usize = 16;

/// The workers that have got the message.
#[derive(Default)]
pub(super) struct Bells([Option<Arc<Doorbell<dyn Middleware>>>; BELLS]);

impl Bells {
    fn add(&mut self, bell: Arc<Doorbell<dyn Middleware>>) {
        for place in &mut self.0 {
            match place {
                Some(known) if Arc::ptr_eq(known, &bell) => return,
                Some(_) => {}
                None => {
                    *place = Some(bell);
                    return;
                }
            }
        }
        bell.ring(clock::monotonic());
    }

    /// Without the lock of the bus: it would wake a thread into it.
    pub(super) fn ring(&self, now: u64) {
        self.0.iter().flatten().for_each(|bell| bell.ring(now));
    }
}

impl InProcess {
    /// [`publish_shared`](Middleware::publish_shared).
    pub(super) fn share(
        &self,
        writer: WriterId,
        message: &Shared,
        payload: Option<&[u8]>,
    ) -> Result<bool, PublishError> {
        if let Some(payload) = payload {
            let sent = self.publish_long(writer, payload, Some(message));
            return sent.map(|()| true);
        }
        let mut bells = Bells::default();
        let (told, now) = {
            let mut bus = self.bus.state.lock();
            if bus.wants_bytes(self.me, writer, message) {
                return Ok(false);
            }
            let (writer, info) = bus.begin(self.me, writer, 0)?;
            let begins = writer.renew(info.arrival);
            let from = (writer.topic, writer.offers, writer.wrote_bytes);
            let told = if begins { bus.watchers() } else { 0 };
            (
                told | bus.share(from, message, &info, &mut bells),
                info.arrival,
            )
        };
        bells.ring(now);
        self.bus.ring(told);
        Ok(true)
    }
}

impl Bus {
    /// Whether a reader of this writer, or one that comes later, needs the message as bytes.
    fn wants_bytes(&self, me: usize, writer: WriterId, message: &Shared) -> bool {
        let mine = self.participant(me);
        let writer = mine.and_then(|p| p.writers.get(usize::from(writer.0)));
        let Some(writer) = writer.filter(|w| !w.deleted) else {
            return false; // an error, in a moment
        };
        let Some(topic) = self.topics.get(writer.topic) else {
            return false;
        };
        let mut readers = topic.readers.iter().filter_map(|&(p, r)| {
            let reader = self.participant(p)?.readers.get(r)?;
            let fits = !topic.clashes || writer.offers.check_offers(reader.requests).is_ok();
            fits.then_some(reader)
        });
        writer.kept.is_some() || !readers.all(|reader| reader.takes(message, writer.wrote_bytes))
    }

    /// Gives the message to each reader that takes it as it is. The participants that are to look
    /// at their deadlines, as bits. `wrote_bytes`: of the writer.
    pub(super) fn share(
        &mut self,
        (topic, offers, wrote_bytes): (usize, Qos, bool),
        message: &Shared,
        info: &SampleInfo,
        bells: &mut Bells,
    ) -> u64 {
        let mut wake = 0;
        self.shares = self.shares.wrapping_add(1);
        let share = self.shares;
        let Some(topic) = self.topics.get(topic) else {
            return wake;
        };
        for &(p, r) in &topic.readers {
            let Some(Some(participant)) = self.participants.get_mut(p) else {
                continue;
            };
            let Some(reader) = participant.readers.get_mut(r) else {
                continue;
            };
            let clashes = topic.clashes && offers.check_offers(reader.requests).is_err();
            if clashes || !reader.takes(message, wrote_bytes) {
                continue;
            }
            reader.last_share = share;
            let delivered = reader.local.as_ref().and_then(|l| l.deliver(message, info));
            if let Some((_, Some(bell))) = delivered {
                bells.add(bell);
            }
            if reader.deadline.renew(info.arrival) {
                wake |= u64::from(!participant.watches.is_empty()) << p;
            }
        }
        wake
    }
}

impl Reader {
    /// Whether it takes this message as it is. A message in memory goes past the queue: not while
    /// bytes of the same writer are on their way there.
    fn takes(&self, message: &Shared, wrote_bytes: bool) -> bool {
        let on_their_way = wrote_bytes && (self.lent || self.queue.len() > 0);
        !on_their_way && self.local.as_ref().is_some_and(|l| l.takes(message))
    }
}
