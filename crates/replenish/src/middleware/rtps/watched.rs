//! Endpoints of a participant that a program watches: their status, and who is told of it.

use super::adapter::Rtps;
use super::state::State;
use crate::middleware::watch::{End, EndStatus, Watch};
use crate::middleware::{MiddlewareError, ReaderId, WriterId};
use crate::sync::Arc;
use replenish_rtps::participant::{EndpointStatus, Policy};

impl Rtps {
    pub(super) fn add_watch(
        &self,
        end: End,
        watch: &Arc<dyn Watch>,
    ) -> Result<(), MiddlewareError> {
        self.state.lock().watches.add(end, watch)?;
        self.tell_watches();
        Ok(())
    }

    /// Tells every watch, each without the lock.
    #[cold]
    pub(super) fn tell_watches(&self) {
        for at in 0.. {
            let state = self.state.lock();
            let Some((end, watch)) = state.watches.get(at) else {
                return;
            };
            let status = state.status(end).unwrap_or_default();
            let news = watch.update(&status).then(|| Arc::clone(watch));
            drop(state);
            if let Some(watch) = news {
                watch.ring();
            }
        }
    }
}

impl State {
    fn status(&self, end: End) -> Option<EndStatus> {
        Some(match end {
            End::Writer(WriterId(at)) => {
                let id = self.writers.get(usize::from(at))?.id?;
                told(&self.participant.writer_status(id)?, 0)
            }
            End::Reader(reader @ ReaderId(at)) => {
                let id = self.readers.get(usize::from(at))?.id?;
                let status = self.participant.reader_status(id)?;
                EndStatus {
                    alive: status.alive as u64,
                    not_alive: status.matched.saturating_sub(status.alive) as u64,
                    ..told(&status, self.lost(reader))
                }
            }
        })
    }
}

fn told(status: &EndpointStatus, lost: u64) -> EndStatus {
    EndStatus {
        matched_total: status.matched_total,
        matched: status.matched as u64,
        incompatible: status.incompatible,
        policy: status.last_incompatible.map_or("", Policy::name),
        wrong_type: status.wrong_type,
        lost,
        deadline_missed: status.deadline_missed,
        liveliness_lost: status.liveliness_lost,
        alive: 0,
        not_alive: 0,
    }
}
