//! `Executor::chain`, and the way from the chains that were asked for to links of handles, before
//! anything runs.

use crate::chain::ChainReport;
use crate::error::Error;
use crate::executor::{Executor, HandleEntry, WorkerSpec, nanos};
use crate::handoff::MOST_CHAINS;
use crate::platform::chain::{ChainInput, ChainName, ChainState, Link, Requested, RequestedChain};
use crate::platform::recorder::ChainFacts;
use crate::platform::{Static, Text};
use core::fmt::Display;
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use std::format;
use std::string::String;
use std::sync::Arc;
use std::vec::Vec;

/// Chains of an executor.
const CHAINS: usize = 64;
/// Stages of a chain.
const STAGES: usize = 16;

/// The chains of an executor that runs.
#[derive(Default)]
pub(crate) struct Chains(pub(super) Vec<Arc<ChainState>>);

impl Chains {
    pub(crate) fn report(&self) -> Vec<ChainReport> {
        self.0.iter().map(|chain| chain.report()).collect()
    }

    /// For the recording.
    pub(crate) fn facts(&self) -> Vec<ChainFacts<'_>> {
        self.0.iter().map(|chain| chain.facts()).collect()
    }
}

impl Executor {
    /// Measures how long it takes from the input of the first stage to the end of the last one.
    ///
    /// There are 1 to 16 stages: each is a handle by its id (`/node/sub:/topic`, `worker/timer:0`)
    /// or a worker by its name, which stands for its subscriptions, or if it has none for its
    /// timers and guard conditions. An instance that takes longer than `limit` is an
    /// [event](crate::Event::ChainExceeded) and is counted; `None` measures alone.
    ///
    /// - An instance begins at the release of a timer, or when the sample was published, if its
    ///   publisher's clock is this host's (a stamp in the future, or more than a minute old, does
    ///   not count: then it begins when the sample arrived).
    /// - A publication made by a callback, on the thread of the callback, takes the instance along
    ///   to subscriptions, services and clients of this process that are the next stage: in
    ///   process and over RTPS, not over DDS-XRCE.
    /// - What the last stage publishes over RTPS takes the chain's name along: the first stage of a
    ///   chain of that name in another process, on this host or on one whose clock agrees, goes on
    ///   with the instance. A sample takes two chains along in that way; of services none.
    /// - A stage without subscription (a timer, a guard condition) takes up the newest instance
    ///   that the stage before has ended, once.
    /// - It ends with each callback of the last stage that it reaches.
    ///
    /// The results are in [`Report::chains`](crate::Report::chains). A deployment file's
    /// `[[chain]]` of the same name replaces it. A handle can be in four chains.
    ///
    /// # Errors
    /// When the executor starts: [`Error::Parameter`] for a stage that
    /// does not exist, and for numbers out of range.
    ///
    /// ```
    /// # use replenish::{Context, Executor};
    /// # use std::time::Duration;
    /// # let mut exec = Executor::new(&Context::in_process());
    /// let limit = Duration::from_millis(20);
    /// exec.chain("brake", ["camera/timer:0", "/detect/sub:/image", "brakes"], limit);
    /// ```
    pub fn chain<S: Into<String>>(
        &mut self,
        name: impl AsRef<str>,
        stages: impl IntoIterator<Item = S>,
        limit: impl Into<Option<Duration>>,
    ) -> &mut Self {
        let stages = stages.into_iter().map(Into::into).collect();
        let limit = limit.into().map(nanos);
        let chains = &mut self.options.chains;
        chains.add(name.as_ref(), stages, limit, None);
        self
    }
}

/// Makes links of the chains that were asked for.
pub(crate) fn start_chains(
    requested: &Requested,
    workers: &mut [Static<WorkerSpec>],
) -> Result<Chains, Error> {
    let count = requested.0.len();
    if count > CHAINS {
        let allowed = format!("up to {CHAINS}");
        return Err(Error::parameter("executor", "chains", &count, allowed));
    }
    let chains = requested.0.iter().map(|chain| chain.start(workers));
    chains.collect::<Result<_, _>>().map(Chains)
}

/// The handles of a stage, as places of workers and of their entries.
type Stage = Vec<(usize, usize)>;

impl RequestedChain {
    fn wrong(&self, field: &'static str, value: &dyn Display, allowed: impl Into<Text>) -> Error {
        Error::parameter(format!("chain {:?}", self.name), field, value, allowed)
    }

    fn start(&self, workers: &mut [Static<WorkerSpec>]) -> Result<Arc<ChainState>, Error> {
        let count = self.stages.len();
        if !(1..=STAGES).contains(&count) {
            let allowed = format!("1..={STAGES}, each a handle's id or a worker's name");
            return Err(self.wrong("stages", &count, allowed));
        }
        if self.limit == Some(0) {
            return Err(self.wrong("limit", &"0 ns", "more than 0, or None"));
        }
        let stages = self.stages.iter().map(|stage| self.find(stage, workers));
        let stages = stages.collect::<Result<Vec<Stage>, Error>>()?;
        let all: Vec<_> = stages.iter().flatten().collect();
        if let Some(twice) = (1..)
            .zip(&all)
            .find(|(n, at)| all.iter().skip(*n).any(|b| b == *at))
        {
            let id = entry_at(workers, **twice.1).map(|entry| entry.shared.id.clone());
            let allowed = "each handle once in a chain";
            return Err(self.wrong("stages", &id.unwrap_or_default(), allowed));
        }
        let samples: Vec<bool> = stages.iter().map(|stage| samples(stage, workers)).collect();
        let stages_named = self.stages.clone();
        let name = self.name.clone();
        let state = Arc::new(ChainState::new(name, stages_named, self.limit, self.bound));
        let mut before = 0;
        for (place, stage) in stages.iter().enumerate() {
            let number = self.number()?;
            for &at in stage {
                let Some(entry) = entry_at(workers, at) else {
                    continue;
                };
                let links = &mut entry.links.0;
                if links.len() == MOST_CHAINS {
                    let allowed = format!("a handle in up to {MOST_CHAINS} chains");
                    return Err(self.wrong("stages", &entry.shared.id, allowed));
                }
                links.push(Link {
                    chain: Arc::clone(&state),
                    number,
                    name: ChainName::of(&self.name),
                    stage: place,
                    input: match (place, entry.shared.input.is_some()) {
                        (0, _) => ChainInput::Source,
                        (_, true) => ChainInput::Sample(before),
                        (_, false) => ChainInput::Newest,
                    },
                    is_sampled: samples.get(place + 1).copied().unwrap_or(false),
                    is_last: place + 1 == count,
                    origin: None,
                });
            }
            before = number;
        }
        Ok(state)
    }

    /// The handles of a stage: one by its id, or those of a worker.
    fn find(&self, stage: &str, workers: &[Static<WorkerSpec>]) -> Result<Stage, Error> {
        let mut found = Stage::new();
        for (at, worker) in workers.iter().enumerate() {
            let is_worker = *worker.request.name == *stage;
            let subscribes = worker.entries.iter().any(is_subscription);
            for (place, entry) in worker.entries.iter().enumerate() {
                let stands = is_worker
                    && if subscribes {
                        is_subscription(entry)
                    } else {
                        entry.shared.input.is_none()
                    };
                if stands || entry.shared.id == stage {
                    found.push((at, place));
                }
            }
        }
        if found.is_empty() {
            let handles = workers.iter().flat_map(|worker| &worker.entries);
            let ids: Vec<String> = handles.map(|entry| entry.shared.id.clone()).collect();
            let allowed = format!(
                "a handle's id, or the name of a worker with subscriptions or timers; the handles are {}",
                ids.join(", ")
            );
            return Err(self.wrong("stages", &format!("{stage:?}"), allowed));
        }
        Ok(found)
    }

    /// A number for a stage that no other one in the process has had.
    fn number(&self) -> Result<u32, Error> {
        static NEXT: AtomicU32 = AtomicU32::new(1);
        let step = |n: u32| n.checked_add(1);
        let number = NEXT.fetch_update(Ordering::Relaxed, Ordering::Relaxed, step);
        let spent = |_| self.wrong("stages", &u32::MAX, "fewer stages in the life of a process");
        number.map_err(spent)
    }
}

fn is_subscription(entry: &HandleEntry) -> bool {
    entry.shared.input.is_some() && entry.shared.id.contains("/sub:")
}

/// Whether the stage has handles that take up the newest instance of the stage before.
fn samples(stage: &Stage, workers: &mut [Static<WorkerSpec>]) -> bool {
    let mut entries = stage.iter();
    entries.any(|at| entry_at(workers, *at).is_some_and(|entry| entry.shared.input.is_none()))
}

fn entry_at(
    workers: &mut [Static<WorkerSpec>],
    (worker, entry): (usize, usize),
) -> Option<&mut HandleEntry> {
    workers.get_mut(worker)?.entries.get_mut(entry)
}
