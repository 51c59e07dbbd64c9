//! The figures of chains in the file: others read them while the program runs, and afterwards.

use super::names::NameId;
use crate::Nanos;
use replenish_os::live::SharedMemory;
use replenish_recorder::{ChainCount, Plan, PlannedChain, Span, add_to_chain, write_chain_worst};
use std::sync::{Arc, OnceLock};
use std::vec::Vec;

/// A chain that is to be measured.
pub(crate) struct ChainFacts<'a> {
    pub(crate) slot: &'a ChainSlot,
    pub(crate) name: &'a str,
    pub(crate) id: NameId,
    pub(crate) limit: Option<Nanos>,
    pub(crate) bound: Option<Nanos>,
}

/// A chain's way to its place in the file; empty where nothing is recorded.
#[derive(Debug, Default)]
pub(crate) struct ChainSlot(OnceLock<(Arc<SharedMemory>, Span)>);

impl ChainSlot {
    /// An instance has begun.
    pub(crate) fn begun(&self) {
        if let Some((memory, span)) = self.0.get() {
            add_to_chain(span.of(memory), ChainCount::Begun, 1);
        }
    }

    /// An instance has ended; its latency is in this bucket.
    pub(crate) fn ended(&self, latency: Nanos, bucket: usize) {
        if let Some((memory, span)) = self.0.get() {
            let entry = span.of(memory);
            add_to_chain(entry, ChainCount::Ended, 1);
            add_to_chain(entry, ChainCount::Sum, latency);
            add_to_chain(entry, ChainCount::Bucket(bucket), 1);
        }
    }

    /// It took longer than its limit.
    pub(crate) fn exceeded(&self) {
        if let Some((memory, span)) = self.0.get() {
            add_to_chain(span.of(memory), ChainCount::Exceeded, 1);
        }
    }

    /// It took longer than all before it. For one thread at a time.
    pub(crate) fn worst(&self, origin: Nanos, latency: Nanos) {
        if let Some((memory, span)) = self.0.get() {
            write_chain_worst(span.of(memory), origin, latency);
        }
    }
}

/// Writes the chains into a file that is being laid out, and gives them their places.
pub(super) fn lay(chains: &[ChainFacts<'_>], plan: &Plan, memory: &Arc<SharedMemory>) {
    let planned = chains.iter().map(|chain| PlannedChain {
        name: chain.name,
        id: chain.id.0,
        limit: chain.limit,
        bound: chain.bound,
    });
    plan.write_chains(memory, &planned.collect::<Vec<_>>());
    for (chain, span) in chains.iter().zip(&plan.chains) {
        chain.slot.0.set((Arc::clone(memory), *span)).ok(); // set once
    }
}
