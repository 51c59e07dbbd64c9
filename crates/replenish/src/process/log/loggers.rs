//! The loggers of a context: names, publishers of `/rosout`, and the queue of lines.

use super::console::Console;
use super::levels::Levels;
use super::line::{Draft, Head, WORDS};
use super::logger::Logger;
use super::writer;
use crate::context::Node;
use crate::handoff::LineQueue;
use crate::publisher::Publisher;
use crate::qos::Qos;
use crate::sync::{Mutex, Notify};
use core::time::Duration;
use replenish_args::{LogArgs, LogLevel};
use replenish_interfaces::rcl_interfaces::msg::Log as LogMessage;
use replenish_os::{Thread, ThreadSpec, clock, spawn};
use std::boxed::Box;
use std::format;
use std::string::String;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::vec::Vec;

/// Lines that may wait.
pub(super) const LINES: usize = 512;
/// Loggers of a context.
const MOST: usize = 4096;
/// The longest message on `/rosout`, in bytes.
const MESSAGE: usize = 1400;
const ROSOUT: Qos = Qos::reliable()
    .keep_last(1000)
    .transient_local()
    .lifespan(Duration::from_secs(10));

/// A logger's name and level.
pub(super) struct Named {
    pub(super) id: u16,
    pub(super) name: Box<str>,
    level: AtomicU8,
}

impl Named {
    pub(super) fn level(&self) -> LogLevel {
        let number = self.level.load(Ordering::Relaxed);
        LogLevel::numbered(number.into()).unwrap_or(LogLevel::Info)
    }

    pub(super) fn passes(&self, level: LogLevel) -> bool {
        level.number() >= self.level.load(Ordering::Relaxed)
    }
}

/// Where the lines of a logger go.
#[derive(Clone)]
pub(super) struct Target {
    pub(super) named: Arc<Named>,
    pub(super) rosout: Option<Publisher<LogMessage>>,
}

struct Table {
    targets: Vec<Target>,
    levels: Levels,
}

impl Table {
    fn find(&self, name: &str) -> Option<&Target> {
        self.targets.iter().find(|t| &*t.named.name == name)
    }

    /// The logger `name`, or the last one if there are too many.
    fn named(&mut self, name: &str, rosout: Option<Publisher<LogMessage>>) -> Arc<Named> {
        if let Some(target) = self.find(name) {
            return Arc::clone(&target.named);
        }
        let last = self.targets.last().filter(|_| self.targets.len() >= MOST);
        if let Some(last) = last {
            return Arc::clone(&last.named);
        }
        let named = Arc::new(Named {
            id: u16::try_from(self.targets.len()).unwrap_or(u16::MAX),
            name: name.into(),
            level: AtomicU8::new(self.levels.of(name).number()),
        });
        self.targets.push(Target {
            named: Arc::clone(&named),
            rosout,
        });
        named
    }
}

/// The log without its thread: what loggers and thread share.
pub(super) struct Core {
    table: Mutex<Table>,
    pub(super) queue: LineQueue<WORDS>,
    pub(super) notify: Notify,
    /// Lines that did not fit.
    pub(super) lost: AtomicU64,
    /// The number of lines that were written, wrapping.
    pub(super) written: AtomicUsize,
    pub(super) ended: AtomicBool,
}

impl Core {
    pub(super) fn push(&self, draft: &Draft, head: Head) {
        let (words, used) = draft.words(head);
        if !self.queue.push(words.get(..used).unwrap_or(&words)) {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        self.notify.set();
    }

    pub(super) fn target(&self, id: u16) -> Option<Target> {
        self.table.lock().targets.get(usize::from(id)).cloned()
    }

    /// The level of this very name; the empty one stands for all.
    pub(super) fn own_level(&self, name: &str) -> Option<LogLevel> {
        self.table.lock().levels.own(name)
    }

    /// Sets the level of a name (of all if it is empty), or takes it away. The error says why it
    /// cannot.
    pub(super) fn set_level(
        &self,
        name: &str,
        level: Option<LogLevel>,
    ) -> Result<(), &'static str> {
        let mut table = self.table.lock();
        table.levels.set(name, level)?;
        for target in &table.targets {
            let level = table.levels.of(&target.named.name);
            target.named.level.store(level.number(), Ordering::Relaxed);
        }
        Ok(())
    }

    /// Waits until the lines up to now are written, up to a second.
    fn flush(&self) {
        let (tail, end) = (self.queue.pushed(), clock::monotonic() + 1_000_000_000);
        let behind = || tail.wrapping_sub(self.written.load(Ordering::Acquire));
        while (1..=LINES).contains(&behind()) && clock::monotonic() < end {
            clock::sleep_until(clock::monotonic() + 500_000);
        }
    }
}

/// The log of a context. Its thread ends with it, when all lines are written.
pub(super) struct Log {
    core: Arc<Core>,
    thread: Option<Thread<()>>,
}

impl Log {
    fn start(args: &LogArgs, colours: Option<bool>) -> Arc<Self> {
        let console = args.stdout.then(|| Console::from_env(colours));
        let core = Arc::new(Core {
            table: Mutex::new(Table {
                targets: Vec::new(),
                levels: Levels::new(args),
            }),
            queue: LineQueue::new(LINES),
            notify: Notify::new(),
            lost: AtomicU64::new(0),
            written: AtomicUsize::new(0),
            ended: AtomicBool::new(false),
        });
        let theirs = Arc::clone(&core);
        let thread = spawn(ThreadSpec::new("log"), move || {
            writer::run(&theirs, console);
        });
        if let Err(e) = &thread {
            crate::platform::tell(&format_args!("no log: {e}"));
        }
        Arc::new(Self {
            core,
            thread: thread.ok(),
        })
    }

    pub(super) fn core(&self) -> &Core {
        &self.core
    }

    pub(super) fn child(self: &Arc<Self>, parent: &Logger, name: &str) -> Logger {
        let mut table = self.core.table.lock();
        let own = table.targets.get(usize::from(parent.id()));
        let rosout = own.and_then(|own| own.rosout.clone());
        let name = format!("{}.{name}", parent.named().name);
        Logger::new(table.named(&name, rosout), Arc::clone(self))
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        self.core.ended.store(true, Ordering::Release);
        self.core.notify.set();
        if let Some(thread) = self.thread.take() {
            thread.join().ok();
        }
    }
}

/// A context's log, which begins with the first logger.
#[derive(Default)]
pub(crate) struct Loggers(OnceLock<Arc<Log>>);

impl Loggers {
    fn log(&self, node: &Node) -> &Arc<Log> {
        self.0.get_or_init(|| {
            let args = node.context().args();
            Log::start(args.log(), args.environment().colours)
        })
    }

    /// Waits until the lines up to now are written, up to a second.
    pub(crate) fn flush(&self) {
        if let Some(log) = self.0.get().filter(|log| log.thread.is_some()) {
            log.core.flush();
        }
    }
}

impl Node {
    /// The logger of this node, which publishes on `/rosout` besides: with the name of the node,
    /// `robot.arm` for `/robot/arm`. For set-up: the first call makes the publisher and, for a
    /// context, the thread that writes. Without `/rosout` a warning says why.
    ///
    /// The arguments `--log-level`, `--disable-stdout-logs` and `--disable-rosout-logs` apply.
    #[must_use]
    pub fn logger(&self) -> Logger {
        let log = self.context().loggers().log(self);
        let name: String = self.name().trim_start_matches('/').replace('/', ".");
        let known = log.core.table.lock().find(&name).cloned();
        if let Some(target) = known {
            return Logger::new(target.named, Arc::clone(log));
        }
        let made = self
            .context()
            .args()
            .log()
            .rosout
            .then(|| self.publisher_sized("/rosout", ROSOUT, MESSAGE));
        let (rosout, refused) = match made {
            None => (None, None),
            Some(Ok(publisher)) => (Some(publisher), None),
            Some(Err(e)) => (None, Some(e)),
        };
        let named = log.core.table.lock().named(&name, rosout);
        let logger = Logger::new(named, Arc::clone(log));
        if let Some(e) = refused {
            crate::log_warn!(logger, "no /rosout: {e}");
        }
        logger
    }

    /// The log of this node's context.
    pub(super) fn log(&self) -> Arc<Log> {
        Arc::clone(self.context().loggers().log(self))
    }
}
