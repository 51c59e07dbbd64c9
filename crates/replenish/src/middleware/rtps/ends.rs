//! [`ReaderEnd`] and [`WriterEnd`]: what the adapter keeps of each endpoint of ours, beside the
//! participant's own; and the way of a sample from a reader to its content.

use super::carried::{self, Carried};
use super::nudge::Nudge;
use super::qos::PADDING;
use super::service_end::ServiceEnd;
use super::shared::Spare;
use crate::Nanos;
use crate::middleware::{ReaderId, SampleInfo};
use crate::platform::wall_clock;
use crate::sync::Arc;
use alloc::boxed::Box;
use replenish_rtps::endpoint::Sample;
use replenish_rtps::participant as rtps;
use replenish_rtps::wire::{CDR_LE, Encapsulated, GuidPrefix, INFINITE, Timestamp};

/// A sample that has left its reader, in its buffer.
pub(super) struct LongSample {
    pub(super) reader: ReaderId,
    pub(super) id: rtps::ReaderId,
    pub(super) info: SampleInfo,
    pub(super) buffer: Box<[u8]>,
    pub(super) len: usize,
}

impl LongSample {
    /// Its bytes, behind the encapsulation.
    pub(super) fn payload(&self) -> &[u8] {
        let rest = self.buffer.get(CDR_LE.len()..).unwrap_or(&[]);
        rest.get(..self.len).unwrap_or(rest)
    }
}

/// A reader of ours.
pub(super) struct ReaderEnd {
    /// `None`: deleted.
    pub(super) id: Option<rtps::ReaderId>,
    pub(super) node: Box<str>,
    pub(super) topic: Box<str>,
    pub(super) limit: usize,
    /// Bytes of the memory for its samples.
    pub(super) memory: usize,
    /// Datagrams that the kernel has dropped at its socket.
    pub(super) dropped: u64,
    /// Samples that could not be read.
    pub(super) unreadable: u64,
    /// Samples that came after their lifespan.
    pub(super) expired: u64,
    pub(super) service: Option<ServiceEnd>,
    /// Wakes the worker that receives its samples, for samples that come another way.
    pub(super) owner: Option<Arc<Nudge>>,
    /// Of a topic with long samples: the buffer that the next one is exchanged for.
    pub(super) spare: Option<Box<[u8]>>,
}

impl ReaderEnd {
    /// Content of a sample; `None` if this reader does not get it.
    pub(super) fn read<'s>(
        &mut self,
        sample: &Sample<'s>,
        (own, carried): (GuidPrefix, &Carried),
        (now, arrival): (Nanos, Nanos),
    ) -> Option<(SampleInfo, &'s [u8])> {
        if sample.gone.is_some() {
            return None;
        }
        let mut info = SampleInfo {
            source_timestamp: sample.source.map(|time| time.0),
            sequence: u64::try_from(sample.sn).ok(),
            ..SampleInfo::at(arrival)
        };
        if sample.writer.prefix == own {
            info.origins = carried.of(sample.writer.entity, sample.sn.unsigned_abs());
        } else {
            info.origins = carried::came(&sample.origins, now);
        }
        if sample.lifespan != INFINITE {
            let age = sample.source.map(age).unwrap_or_default();
            let Some(left) = sample.lifespan.checked_sub(age).filter(|left| *left > 0) else {
                self.expired += 1;
                return None;
            };
            info.expires = Some(now.saturating_add(left));
        }
        let cdr = Encapsulated::decode(sample.payload).ok();
        // Plain CDR, little endian: nobody in ROS 2 sends another one.
        let Some(mut payload) = cdr
            .filter(|cdr| cdr.representation == 1)
            .map(|cdr| cdr.data)
        else {
            self.unreadable += 1;
            return None;
        };
        if let Some(service) = &mut self.service {
            // Nothing: somebody else's.
            (info.request, payload) = service.identify(sample, payload)?;
        }
        if payload.len() <= self.limit.saturating_add(PADDING) {
            payload = payload.get(..self.limit).unwrap_or(payload);
        }
        Some((info, payload))
    }
}

/// A writer of ours.
pub(super) struct WriterEnd {
    /// `None`: deleted.
    pub(super) id: Option<rtps::WriterId>,
    pub(super) node: Box<str>,
    pub(super) topic: Box<str>,
    pub(super) limit: usize,
    /// Room for the next sample, filled without the lock.
    pub(super) spare: Option<Spare>,
    /// Of a service: the reader at the same end.
    pub(super) partner: Option<ReaderId>,
}

/// The time since a moment of the wall clock.
fn age(source: Timestamp) -> Nanos {
    let now = wall_clock().and_then(|now| u64::try_from(now.as_nanos()).ok());
    now.map_or(0, |now| now.saturating_sub(source.0))
}
