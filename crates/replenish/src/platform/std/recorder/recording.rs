//! One executor's recording: laid out before its threads start, gone when it ends in order.

use super::chains::{self, ChainFacts};
use super::dump::Dump;
use super::dumper::Dumper;
use super::local::{self, Local};
use super::names::{self, Table};
use super::place::{self, Wanted};
use super::trigger::Armed;
use replenish_os::live::{LiveFile, SharedMemory, SharedSlice, clocks};
use replenish_os::{Account, BudgetRecord, clock};
use replenish_recorder::{Plan, Planned, Role, ThreadSpan, Writer, write_policy, write_tid};
use std::path::PathBuf;
use std::string::{String, ToString};
use std::sync::{Arc, OnceLock};
use std::vec::Vec;

/// Size and place of the recording.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// Bytes of each thread's ring; 0: nothing is recorded.
    pub(crate) bytes: usize,
    /// The directory of the ledger.
    #[allow(dead_code, reason = "named by builds with feature `plan`")]
    pub(crate) ledger: Option<PathBuf>,
    /// The causes for which it is written to a file.
    pub(crate) dump: Option<Dump>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            bytes: 256 << 10,
            ledger: None,
            dump: None,
        }
    }
}

/// A thread that is to start.
pub(crate) struct ThreadFacts<'a> {
    pub(crate) slot: &'a ThreadSlot,
    pub(crate) name: &'a str,
    pub(crate) dispatches: bool,
    pub(crate) cpu: Option<usize>,
    /// Budget and period.
    pub(crate) budget: Option<(u64, u64)>,
}

/// A thread's way to its places in the recording; empty where nothing is recorded.
#[derive(Debug, Default)]
pub(crate) struct ThreadSlot(OnceLock<Laid>);

/// The places of a thread.
#[derive(Debug)]
struct Laid {
    memory: Arc<SharedMemory>,
    span: ThreadSpan,
    armed: Option<Arc<Armed>>,
}

/// The recording of an executor.
#[derive(Debug, Default)]
pub(crate) struct Recording {
    /// The file is removed with it.
    place: Option<LiveFile>,
    table: Option<Arc<Table>>,
    dumper: Option<Dumper>,
    /// The reason why there is no file, or no dump.
    pub(crate) fallback: Option<String>,
}

impl Recording {
    /// Lays out a recording for these threads and chains. The error says which sizes are allowed.
    pub(crate) fn start<'a>(
        settings: &Settings,
        threads: impl Iterator<Item = ThreadFacts<'a>>,
        chains: &[ChainFacts<'_>],
    ) -> Result<Self, String> {
        let wanted = place::wanted();
        if settings.bytes == 0 || matches!(wanted, Wanted::Off) {
            let asked = settings.dump.as_ref();
            return Ok(Self {
                fallback: asked.map(|_| "nothing is recorded, so no dump is written".into()),
                ..Self::default()
            });
        }
        let facts: Vec<ThreadFacts<'a>> = threads.collect();
        let planned = facts.iter().map(|thread| Planned {
            name: thread.name,
            role: if thread.dispatches {
                Role::Dispatcher
            } else {
                Role::Worker
            },
            cpu: thread.cpu,
            budget: thread.budget,
        });
        let planned: Vec<Planned<'_>> = planned.collect();
        let plan = Plan::with_chains(&planned, chains.len(), settings.bytes);
        let plan = plan.map_err(|e| e.to_string())?;
        let found = place::find(wanted, settings.ledger.as_deref(), plan.bytes);
        let (place, memory, fallback) = match found {
            Ok((place, memory)) => (Some(place), memory, None),
            Err(why) => {
                let fallback = std::format!(
                    "the recorder's file cannot be made: `replenish top` and `trace` do not see \
                     this program ({why}; {} names another directory, or is off)",
                    place::VARIABLE
                );
                match SharedMemory::private(plan.bytes) {
                    Ok(memory) => (None, memory, Some(fallback)),
                    Err(_) => {
                        return Ok(Self {
                            fallback: Some(fallback),
                            ..Self::default()
                        });
                    }
                }
            }
        };
        let program = std::env::args_os().next().map(PathBuf::from);
        let program = program.as_deref().and_then(|p| p.file_name());
        let program = program.map_or_else(String::new, |p| p.to_string_lossy().into_owned());
        let memory = Arc::new(memory);
        chains::lay(chains, &plan, &memory);
        plan.write(&memory, &program, std::process::id(), clocks(), &planned);
        let (dumper, undumped) = dumper(settings, &memory);
        for (thread, span) in facts.iter().zip(&plan.threads) {
            let laid = Laid {
                memory: Arc::clone(&memory),
                span: *span,
                armed: dumper.as_ref().map(|(armed, _)| Arc::clone(armed)),
            };
            thread.slot.0.set(laid).ok(); // set once
        }
        let names = plan.names;
        let table = Arc::new(Table { memory, names });
        names::fill(&table);
        Ok(Self {
            place,
            table: Some(table),
            dumper: dumper.map(|(_, dumper)| dumper),
            fallback: fallback.or(undumped),
        })
    }

    /// Ends the recording in order: its last seconds are not needed.
    pub(crate) fn end(&mut self) {
        self.dumper = None; // its last dump, and the counts in the file, come before the end of it
        self.place = None;
        self.table = None;
    }
}

/// The thread that writes dumps, with its trigger; or the reason why there is none.
fn dumper(
    settings: &Settings,
    memory: &Arc<SharedMemory>,
) -> (Option<(Arc<Armed>, Dumper)>, Option<String>) {
    let Some(dump) = &settings.dump else {
        return (None, None);
    };
    let armed = Arc::new(Armed::new(dump));
    match Dumper::start(dump.clone(), Arc::clone(&armed), memory) {
        Ok(dumper) => (Some((armed, dumper)), None),
        Err(e) => {
            let directory = dump.directory.display();
            let why = std::format!("no dumps are written to {directory}: {e}");
            (None, Some(why))
        }
    }
}

impl ThreadSlot {
    /// The calling thread, which has this account and policy, records from now on.
    pub(crate) fn install(&self, account: &Account, granted: &str) {
        let Some(Laid {
            memory,
            span,
            armed,
        }) = self.0.get()
        else {
            return;
        };
        let entry = span.entry.of(memory);
        write_policy(entry, granted);
        write_tid(entry, u64::from(account.meter().tid().get().unsigned_abs()));
        if let Some(record) = BudgetRecord::new(memory, span) {
            account.record(record);
        }
        if let Some(writer) = Writer::new(span.ring.words) {
            local::install(Local {
                ring: SharedSlice::new(memory, span.ring),
                writer,
                last: clock::monotonic(),
                limit: u64::MAX,
                fired: None,
                left_out: 0,
                open: None,
                entry: SharedSlice::new(memory, span.entry),
                bound: armed.as_ref().map_or(u64::MAX, |armed| armed.bound),
                armed: armed.clone(),
            });
        }
    }
}
