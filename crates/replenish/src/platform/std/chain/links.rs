//! A handle's places in chains, in the hands of its worker.

use super::across::ChainName;
use super::current::resume;
use super::state::ChainState;
use crate::Nanos;
use crate::event::Events;
use crate::handoff::{Origins, SampleInfo, published_at};
use crate::platform::{recorder, wall_clock};
use replenish_os::clock;
use std::sync::Arc;
use std::vec::Vec;

/// Time of publication and chain origins that a sample carries.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Provenance {
    /// Time at which it was published, in nanoseconds since the Unix epoch.
    published: Option<Nanos>,
    origins: Origins,
}

impl Provenance {
    #[inline]
    pub(crate) fn of(info: &SampleInfo) -> Self {
        Self {
            published: info.source_timestamp,
            origins: info.origins,
        }
    }
}

/// The source of a link's origin.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Input {
    /// The link is the first stage.
    Source,
    /// The sample comes from this link.
    Sample(u32),
    /// The link takes up the newest instance of the stage before.
    Newest,
}

/// A place in one chain.
pub(crate) struct Link {
    pub(crate) chain: Arc<ChainState>,
    /// Its number in the process.
    pub(crate) number: u32,
    pub(crate) name: ChainName,
    pub(crate) stage: usize,
    pub(crate) input: Input,
    /// The next stage samples.
    pub(crate) is_sampled: bool,
    pub(crate) is_last: bool,
    /// Origin of the callback that runs.
    pub(crate) origin: Option<Nanos>,
}

/// A handle's places; most handles have none.
#[derive(Default)]
pub(crate) struct Links(pub(crate) Vec<Link>);

impl Links {
    /// The callback begins, at `started`, with input that was released at `due`.
    #[inline]
    pub(crate) fn begin(&mut self, due: Nanos, started: Nanos, provenance: &Provenance) {
        if !self.0.is_empty() {
            self.enter(due, started, provenance);
        }
    }

    /// Notes that the callback has ended; `None`: it did not run, or panicked.
    #[inline]
    pub(crate) fn end(&mut self, end: Option<Nanos>, events: &Events) {
        if !self.0.is_empty() {
            self.leave(end, events);
        }
    }

    #[inline(never)]
    fn enter(&mut self, due: Nanos, started: Nanos, provenance: &Provenance) {
        let mut origins = Origins::NONE;
        for link in &mut self.0 {
            link.origin = match link.input {
                Input::Source => {
                    link.chain.begin();
                    let begun = provenance.origins.from_link(link.name.came());
                    Some(begun.unwrap_or_else(|| published(provenance.published, due)))
                }
                Input::Sample(before) => provenance.origins.from_link(before),
                Input::Newest => link.chain.take_up(link.stage.wrapping_sub(1)),
            };
            if let Some(origin) = link.origin {
                let number = if link.is_last {
                    link.name.sent()
                } else {
                    link.number
                };
                origins.add(number, origin); // a handle has no more links than there is room for
                recorder::chain_stage(link.chain.id, started, origin, link.stage);
            }
        }
        resume(origins);
    }

    #[inline(never)]
    fn leave(&mut self, end: Option<Nanos>, events: &Events) {
        resume(Origins::NONE);
        for link in &mut self.0 {
            let Some((origin, end)) = link.origin.take().zip(end) else {
                continue;
            };
            if link.is_sampled {
                link.chain.offer(link.stage, origin);
            }
            if link.is_last {
                link.chain.end(origin, end, events);
            }
        }
    }
}

/// The instant at which a sample was published by its publisher's clock, if that can be this
/// host's; otherwise its release.
fn published(stamp: Option<Nanos>, due: Nanos) -> Nanos {
    let wall = wall_clock().and_then(|time| u64::try_from(time.as_nanos()).ok());
    let known = stamp.zip(wall);
    known.map_or(due, |(stamp, wall)| {
        published_at(stamp, due, (wall, clock::monotonic()))
    })
}
