//! Deadlines and liveliness of a bus's endpoints, for those who watch them.
//!
//! Nothing is counted where nobody watches: the dispatcher of a participant that does wakes when a
//! promise is broken, and counts for all.

use super::bus::{Bus, Writer};
use crate::Nanos;
use crate::middleware::ReaderId;
use crate::platform::{Deadline, Lease};
use crate::qos::{Liveliness, Qos};
use core::time::Duration;

/// A time in nanoseconds; `None` if it is zero, which says nothing.
pub(super) fn promised(time: Option<Duration>) -> Option<Nanos> {
    let time = time.filter(|time| !time.is_zero())?;
    Some(u64::try_from(time.as_nanos()).unwrap_or(Nanos::MAX))
}

pub(super) fn deadline(qos: Qos) -> Deadline {
    Deadline::new(promised(qos.deadline).unwrap_or(Nanos::MAX))
}

/// One that is automatic ends with its program, and so does the bus.
pub(super) fn lease(qos: Qos) -> Lease {
    let manual = qos.liveliness != Liveliness::Automatic;
    let time = promised(qos.lease).filter(|_| manual);
    Lease::new(time.unwrap_or(Nanos::MAX))
}

pub(super) fn earlier(deadline: Option<Nanos>, promise: Nanos) -> Option<Nanos> {
    if promise == Nanos::MAX {
        return deadline;
    }
    Some(deadline.map_or(promise, |at| at.min(promise)))
}

impl Writer {
    /// Notes a written sample. Returns whether a watching participant must wake at another time.
    pub(super) fn renew(&mut self, now: Nanos) -> bool {
        let begins = self.deadline.renew(now);
        self.lease.renew(now) | begins
    }
}

impl Bus {
    /// When the participant that watches has to look again.
    pub(super) fn next_promise(&self, me: usize) -> Nanos {
        let Some(mine) = self.participant(me).filter(|mine| !mine.watches.is_empty()) else {
            return Nanos::MAX;
        };
        let writers = self.participants().flat_map(|(_, of)| &of.writers);
        let writers = writers.filter(|writer| !writer.deleted);
        let writers = writers.map(|writer| writer.deadline.next().min(writer.lease.next()));
        let readers = mine.readers.iter().filter(|reader| !reader.deleted);
        let readers = readers.map(|reader| reader.deadline.next());
        writers.chain(readers).min().unwrap_or(Nanos::MAX)
    }

    /// Counts the promises that are broken by now.
    pub(super) fn check_promises(&mut self, me: usize, now: Nanos) {
        for (_, participant) in self.participants_mut() {
            for writer in &mut participant.writers {
                writer.deadline.check(now);
                writer.lease.check(now);
            }
        }
        let readers = self.participant(me).map_or(0, |mine| mine.readers.len());
        for at in 0..readers {
            let alone = self.count_writers(me, super::id(at)) == Some(0);
            let mine = self.participant_mut(me);
            if let Some(reader) = mine.and_then(|mine| mine.readers.get_mut(at)) {
                if alone {
                    reader.deadline.stop();
                }
                reader.deadline.check(now);
            }
        }
    }

    /// The writers that a reader hears and that are alive.
    pub(super) fn count_alive(&self, me: usize, reader: ReaderId) -> usize {
        let writers = self.writers_of(me, reader).into_iter().flatten();
        writers.filter(|writer| writer.lease.is_alive()).count()
    }
}
