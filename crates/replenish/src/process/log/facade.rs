//! The `log` facade: lines of libraries that know nothing of nodes, through the log of a context.
//!
//! ```text
//!   log::info!(…) ── max_level ─► Facade ─► line: "target" and text ─► queue ─► writer
//!                    one load      │ no lock, no allocation                      │ splits, and
//!                                  └ the node's logger                            └ judges the level
//! ```

use super::core::Core;
use super::foreign::{BETWEEN, SITE};
use super::logger::Logger;
use crate::error::Error;
use crate::handoff::{LineDraft, LineHead};
use crate::platform::wall_clock;
use log::{Level, Log, Metadata, Record, SetLoggerError};
use replenish_args::LogLevel;
use std::format;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Arc, OnceLock};

/// The longest target, in bytes; the end of a longer one.
const LONGEST: usize = 100;

/// The process has one. It holds no thread: lines that come after the end of its context are lost.
struct Facade {
    core: OnceLock<Arc<Core>>,
    logger: AtomicU16,
}

static FACADE: Facade = Facade {
    core: OnceLock::new(),
    logger: AtomicU16::new(0),
};

/// A level of the facade as one of ROS, which has no trace.
const fn level(level: Level) -> LogLevel {
    match level {
        Level::Error => LogLevel::Error,
        Level::Warn => LogLevel::Warn,
        Level::Info => LogLevel::Info,
        Level::Debug | Level::Trace => LogLevel::Debug,
    }
}

impl Log for Facade {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= log::max_level()
    }

    fn log(&self, record: &Record<'_>) {
        let Some(core) = self.core.get().filter(|_| self.enabled(record.metadata())) else {
            return;
        };
        let target = record.target();
        let mut from = target.len().saturating_sub(LONGEST);
        while !target.is_char_boundary(from) {
            from += 1;
        }
        let target = target.get(from..).unwrap_or_default();
        let draft = LineDraft::of(format_args!("{target}{BETWEEN}{}", record.args()));
        let since_1970 = wall_clock().unwrap_or_default().as_nanos();
        let head = LineHead {
            stamp: u64::try_from(since_1970).unwrap_or(u64::MAX),
            level: level(record.level()).number(),
            logger: self.logger.load(Ordering::Relaxed),
            site: SITE,
        };
        core.push(&draft, head);
    }

    fn flush(&self) {}
}

impl Logger {
    /// Makes this logger the program's logger of the [`log`](https://docs.rs/log) facade.
    ///
    /// From then on lines that any library says with `log::info!` and its siblings go to the
    /// console and to `/rosout`, as those of this logger's child of their target: a line of
    /// `serialport::posix` is `robot.arm.serialport.posix`, and has the level of that name
    /// (`--log-level robot.arm.serialport:=debug`) or of the nearest parent. `trace` is `DEBUG`.
    ///
    /// A line costs a real-time callback the same as [`log_info!`](crate::log_info): no lock, no
    /// allocation, no wait. Lines that no name's level lets pass cost one load. A level that one
    /// name alone has is judged by the thread that writes; until then its lines are in the queue.
    /// The target counts among the 464 bytes of a line. Lines after the end of the context are
    /// lost, and so are file and line on `/rosout`.
    ///
    /// Once in a process; again for the same logger, it changes nothing.
    ///
    /// ```
    /// use replenish::Context;
    /// let ctx = Context::in_process();
    /// ctx.node("robot/arm")?.logger().install()?;
    /// # Ok::<(), replenish::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Parameter`] if the process has another logger of the facade.
    pub fn install(&self) -> Result<(), Error> {
        let core = self.core();
        let ours = || {
            FACADE
                .core
                .get()
                .is_some_and(|known| Arc::ptr_eq(known, core))
        };
        let set = || -> Result<(), SetLoggerError> {
            log::set_logger(&FACADE)?;
            FACADE.logger.store(self.id(), Ordering::Relaxed);
            FACADE.core.set(Arc::clone(core)).ok();
            Ok(())
        };
        if !(ours() && FACADE.logger.load(Ordering::Relaxed) == self.id()) && set().is_err() {
            let owner = format!("logger {}", self.name());
            let allowed = "the first logger of the `log` facade: the process has another one";
            return Err(Error::parameter(owner, "install", &"set", allowed));
        }
        core.let_facade_pass(self.name());
        Ok(())
    }
}
