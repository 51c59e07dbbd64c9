//! The state that loggers and the writer's thread share: names, publishers of `/rosout`, levels,
//! and the queue of lines.

use crate::handoff::{LINE_WORDS, LineDraft, LineHead, LineQueue};
use crate::publisher::Publisher;
use crate::sync::{Mutex, Notify};
use log::LevelFilter;
use replenish_args::{LogArgs, LogLevel, LogLevels};
use replenish_interfaces::rcl_interfaces::msg::Log as LogMessage;
use replenish_os::clock;
use std::boxed::Box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::vec::Vec;

/// Lines that may wait.
pub(super) const LINES: usize = 512;
/// Loggers of a context.
const MOST: usize = 4096;

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

/// The targets of a logger's lines: the logger itself and, if it publishes, `/rosout`.
#[derive(Clone)]
pub(super) struct Target {
    pub(super) named: Arc<Named>,
    pub(super) rosout: Option<Publisher<LogMessage>>,
}

/// The levels of the `log` facade that pass `lowest`.
fn filter(lowest: LogLevel) -> LevelFilter {
    match lowest {
        LogLevel::Fatal => LevelFilter::Off,
        LogLevel::Error => LevelFilter::Error,
        LogLevel::Warn => LevelFilter::Warn,
        LogLevel::Info => LevelFilter::Info,
        _ => LevelFilter::Trace,
    }
}

struct Table {
    targets: Vec<Target>,
    levels: LogLevels,
    /// The logger that lines of the `log` facade go to.
    facade: Option<Box<str>>,
}

impl Table {
    /// The facade lets lines pass that one of its names lets pass.
    fn let_facade_pass(&self) {
        if let Some(name) = &self.facade {
            log::set_max_level(filter(self.levels.lowest(name)));
        }
    }

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
    pub(super) queue: LineQueue<LINE_WORDS>,
    pub(super) notify: Notify,
    /// Lines that did not fit.
    pub(super) lost: AtomicU64,
    /// The number of lines that were written, wrapping.
    pub(super) written: AtomicUsize,
    pub(super) ended: AtomicBool,
}

impl Core {
    pub(super) fn new(args: &LogArgs) -> Self {
        Self {
            table: Mutex::new(Table {
                targets: Vec::new(),
                levels: LogLevels::new(args),
                facade: None,
            }),
            queue: LineQueue::new(LINES),
            notify: Notify::new(),
            lost: AtomicU64::new(0),
            written: AtomicUsize::new(0),
            ended: AtomicBool::new(false),
        }
    }

    /// The logger of this name, if there is one.
    pub(super) fn find(&self, name: &str) -> Option<Arc<Named>> {
        let table = self.table.lock();
        table.find(name).map(|target| Arc::clone(&target.named))
    }

    /// The logger of this name, which is made if there is none; the last one if there are too many.
    pub(super) fn named(&self, name: &str, rosout: Option<Publisher<LogMessage>>) -> Arc<Named> {
        self.table.lock().named(name, rosout)
    }

    pub(super) fn push(&self, draft: &LineDraft, head: LineHead) {
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
        table.let_facade_pass();
        for target in &table.targets {
            let level = table.levels.of(&target.named.name);
            target.named.level.store(level.number(), Ordering::Relaxed);
        }
        Ok(())
    }

    /// Lines of the `log` facade go to the logger `name` from now on.
    pub(super) fn let_facade_pass(&self, name: &str) {
        let mut table = self.table.lock();
        table.facade = Some(name.into());
        table.let_facade_pass();
    }

    /// Whether a line of this name and level is written.
    pub(super) fn passes(&self, name: &str, level: LogLevel) -> bool {
        level.number() >= self.table.lock().levels.of(name).number()
    }

    /// Waits until the lines up to now are written, up to a second.
    pub(super) fn flush(&self) {
        let (tail, end) = (self.queue.pushed(), clock::monotonic() + 1_000_000_000);
        let behind = || tail.wrapping_sub(self.written.load(Ordering::Acquire));
        while (1..=LINES).contains(&behind()) && clock::monotonic() < end {
            clock::sleep_until(clock::monotonic() + 500_000);
        }
    }
}
