//! The chains of samples on their way through the network. Stages mean something in their process
//! alone, so a participant keeps those of its own last samples, for its own readers. Names of
//! chains go over the wire, to other participants.

use crate::Nanos;
use crate::handoff::Origins;
use crate::platform::chain;
use alloc::boxed::Box;
use alloc::vec;
use replenish_rtps::wire::{ChainOrigin, ChainOrigins, EntityId};

/// The chains whose last stage publishes a sample now.
pub(super) fn sent() -> ChainOrigins {
    chain::sent().map(|(chain, time)| ChainOrigin { chain, time })
}

/// The chains of another participant's sample, which arrived now.
pub(super) fn came(origins: &ChainOrigins, now: Nanos) -> Origins {
    chain::came(&origins.map(|origin| (origin.chain, origin.time)), now)
}

/// Samples that are remembered. A power of two.
const SAMPLES: usize = 512;

/// A sample: its writer's name in the participant and its number, with its chains.
type Remembered = (EntityId, u64, Origins);

/// The chains of the last samples. Newer ones overwrite older ones, and nothing allocates.
pub(super) struct Carried {
    samples: Box<[Remembered]>,
    is_used: bool,
}

impl Carried {
    pub(super) fn new() -> Self {
        Self {
            samples: vec![(EntityId::UNKNOWN, 0, Origins::NONE); SAMPLES].into_boxed_slice(),
            is_used: false,
        }
    }

    /// The calling thread has published this sample.
    pub(super) fn remember(&mut self, writer: EntityId, number: u64) {
        let origins = chain::current();
        if origins.is_empty() {
            return;
        }
        self.is_used = true;
        if let Some(place) = self.samples.get_mut(place(writer, number)) {
            *place = (writer, number, origins);
        }
    }

    /// The chains of this own sample.
    pub(super) fn of(&self, writer: EntityId, number: u64) -> Origins {
        if !self.is_used {
            return Origins::NONE;
        }
        let sample = self.samples.get(place(writer, number));
        let found = sample.filter(|(by, at, _)| (*by, *at) == (writer, number));
        found.map_or(Origins::NONE, |(_, _, origins)| *origins)
    }
}

/// Successive samples of a writer have successive places; writers begin at different ones.
fn place(writer: EntityId, number: u64) -> usize {
    let begin = u64::from(u32::from_be_bytes(writer.0)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
    usize::try_from(begin.wrapping_add(number) % SAMPLES as u64).unwrap_or(0)
}
