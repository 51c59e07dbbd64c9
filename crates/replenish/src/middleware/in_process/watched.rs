//! Endpoints of a bus that a program watches: their status, and who is told of it.

use super::InProcess;
use super::bus::Bus;
use crate::compatibility::QosClash;
use crate::middleware::watch::{End, EndStatus, Watch};
use crate::middleware::{MiddlewareError, PublishError, WriterId};
use crate::sync::Arc;
use replenish_os::clock;

impl InProcess {
    pub(super) fn show_life(&self, writer: WriterId) -> Result<(), PublishError> {
        let told = {
            let mut bus = self.bus.state.lock();
            let mine = bus.participant_mut(self.me);
            let writer = mine.and_then(|p| p.writers.get_mut(usize::from(writer.0)));
            let writer = writer.filter(|writer| !writer.deleted);
            let writer = writer.ok_or(PublishError::UnknownWriter)?;
            if writer.lease.renew(clock::monotonic()) {
                bus.watchers()
            } else {
                0
            }
        };
        self.bus.ring(told);
        Ok(())
    }

    pub(super) fn add_watch(
        &self,
        end: End,
        watch: &Arc<dyn Watch>,
    ) -> Result<(), MiddlewareError> {
        self.bus.state.lock().me(self.me)?.watches.add(end, watch)?;
        self.tell_watches();
        Ok(())
    }

    /// Tells every watch of this participant, each without the lock.
    #[cold]
    pub(super) fn tell_watches(&self) {
        let now = clock::monotonic();
        self.bus.state.lock().check_promises(self.me, now);
        for at in 0.. {
            let bus = self.bus.state.lock();
            let me = bus.participant(self.me);
            let Some((end, watch)) = me.and_then(|me| me.watches.get(at)) else {
                return;
            };
            let status = bus.status(self.me, end).unwrap_or_default();
            let news = watch.update(&status).then(|| Arc::clone(watch));
            drop(bus);
            if let Some(watch) = news {
                watch.ring();
            }
        }
    }
}

impl Bus {
    /// The participants that watch endpoints, as bits: something has changed that may concern them.
    pub(super) fn watchers(&self) -> u64 {
        let all = self.participants();
        let watching = all.filter(|(_, participant)| !participant.watches.is_empty());
        watching.fold(0, |bits, (at, _)| bits | 1 << at)
    }

    fn status(&self, me: usize, end: End) -> Option<EndStatus> {
        let mine = self.participant(me)?;
        let count = |found: Option<usize>| found.unwrap_or(0) as u64;
        Some(match end {
            End::Writer(writer) => {
                let end = mine.writers.get(usize::from(writer.0))?;
                EndStatus {
                    matched: count(self.count_readers(me, writer)),
                    deadline_missed: end.deadline.missed(),
                    liveliness_lost: end.lease.lost(),
                    ..end.status
                }
            }
            End::Reader(reader) => {
                let end = mine.readers.get(usize::from(reader.0))?;
                let matched = count(self.count_writers(me, reader));
                let alive = self.count_alive(me, reader) as u64;
                EndStatus {
                    matched,
                    alive,
                    not_alive: matched.saturating_sub(alive),
                    deadline_missed: end.deadline.missed(),
                    lost: end.lost,
                    ..end.status
                }
            }
        })
    }
}

impl EndStatus {
    /// A peer of the topic has come.
    pub(super) fn met(&mut self, fit: Result<(), &QosClash>) {
        match fit {
            Ok(()) => self.matched_total += 1,
            Err(clash) => {
                self.incompatible += 1;
                self.policy = clash.policies().next().unwrap_or_default();
            }
        }
    }
}
