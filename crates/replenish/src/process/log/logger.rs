//! A logger, and how often a place may speak through it.

use super::core::{Core, Named};
use super::loggers::Log;
use super::site::LogSite;
use crate::Nanos;
use crate::executor::nanos;
use crate::handoff::{LineDraft, LineHead};
use crate::platform::wall_clock;
use core::fmt;
use core::time::Duration;
use replenish_args::LogLevel;
use replenish_os::clock;
use std::format;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The logger of a [node](crate::Node::logger), or a [child](Self::child) of it. Clones are the
/// same logger; any thread may use them.
///
/// [`log_info!`](crate::log_info) and its siblings write through it, in real-time callbacks, too:
/// a line is formatted on the caller's stack and put into a queue of 512 lines, without a lock, an
/// allocation or a wait. One ordinary thread of the context takes the lines to the console and to
/// `/rosout`. While the queue is full, lines are lost; a warning then says how many. A text of more
/// than 464 bytes is cut and ends in `…`.
///
/// ```
/// use replenish::{Context, log_info, log_warn};
/// use std::time::Duration;
///
/// let ctx = Context::in_process();
/// let logger = ctx.node("robot/arm")?.logger();
/// assert_eq!(logger.name(), "robot.arm");
/// log_info!(logger, "joint {} moves", 3);
/// for _ in 0..100 {
///     log_warn!(logger.throttle(Duration::from_secs(1)), "it is warm"); // once a second
/// }
/// # Ok::<(), replenish::Error>(())
/// ```
#[derive(Clone)]
pub struct Logger {
    named: Arc<Named>,
    log: Arc<Log>,
}

impl Logger {
    pub(super) const fn new(named: Arc<Named>, log: Arc<Log>) -> Self {
        Self { named, log }
    }

    pub(super) fn core(&self) -> &Arc<Core> {
        self.log.core()
    }

    pub(super) fn id(&self) -> u16 {
        self.named.id
    }

    /// The name, `robot.arm` for the node `/robot/arm`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.named.name
    }

    /// The logger `NAME.name`, which has the level of this one unless it gets its own. For set-up:
    /// the first call for a name allocates. The 4096th logger of a context has no children.
    #[must_use]
    pub fn child(&self, name: &str) -> Self {
        let core = self.log.core();
        let rosout = core.target(self.named.id).and_then(|own| own.rosout);
        let named = core.named(&format!("{}.{name}", self.name()), rosout);
        Self::new(named, Arc::clone(&self.log))
    }

    /// Lines below this level are not written. `Info`, unless `--log-level`, this method or the
    /// service `~/set_logger_levels` said another one for this logger or a parent.
    #[must_use]
    pub fn level(&self) -> LogLevel {
        self.named.level()
    }

    /// Sets the level of this logger, and of its children that have none of their own. Returns
    /// whether it could: 64 names of a context, each of up to 256 bytes, may have levels besides
    /// those of the arguments.
    pub fn set_level(&self, level: LogLevel) -> bool {
        self.log
            .core()
            .set_level(&self.named.name, Some(level))
            .is_ok()
    }

    /// Whether a line of this level is written. One load.
    #[must_use]
    pub fn is_enabled(&self, level: LogLevel) -> bool {
        self.named.passes(level)
    }

    /// A logger that writes only the first time that the place in the source is reached.
    #[must_use]
    pub const fn once(&self) -> LogRule<'_> {
        LogRule {
            logger: self,
            rule: Rule::Once,
        }
    }

    /// A logger that writes at most once in this time for each place in the source; steady time.
    #[must_use]
    pub fn throttle(&self, pause: Duration) -> LogRule<'_> {
        LogRule {
            logger: self,
            rule: Rule::Throttle(nanos(pause)),
        }
    }
}

impl fmt::Debug for Logger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Logger")
            .field("name", &self.name())
            .field("level", &self.level())
            .finish_non_exhaustive()
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Rule {
    Always,
    Once,
    Throttle(Nanos),
}

/// A logger and how often a place may speak: [`Logger::once`], [`Logger::throttle`].
#[derive(Debug, Clone, Copy)]
pub struct LogRule<'a> {
    pub(super) logger: &'a Logger,
    pub(super) rule: Rule,
}

/// The first argument of the macros: a [`Logger`] or a [`LogRule`].
pub trait LogTo {
    /// The logger, and how often.
    fn log_rule(&self) -> LogRule<'_>;
}

impl LogTo for Logger {
    fn log_rule(&self) -> LogRule<'_> {
        LogRule {
            logger: self,
            rule: Rule::Always,
        }
    }
}

impl LogTo for LogRule<'_> {
    fn log_rule(&self) -> LogRule<'_> {
        *self
    }
}

impl<T: LogTo + ?Sized> LogTo for &T {
    fn log_rule(&self) -> LogRule<'_> {
        (**self).log_rule()
    }
}

impl LogSite {
    #[doc(hidden)]
    pub fn passes(&self, level: LogLevel, rule: &LogRule<'_>) -> bool {
        rule.logger.is_enabled(level)
            && match rule.rule {
                Rule::Always => true,
                Rule::Once => !self.said.swap(true, Ordering::Relaxed),
                Rule::Throttle(pause) => {
                    let (now, next) = (clock::monotonic(), self.next.load(Ordering::Relaxed));
                    let then = now.saturating_add(pause);
                    let order = Ordering::Relaxed;
                    now >= next && self.next.compare_exchange(next, then, order, order).is_ok()
                }
            }
    }

    #[doc(hidden)]
    pub fn log(&'static self, level: LogLevel, rule: &LogRule<'_>, text: fmt::Arguments<'_>) {
        let since_1970 = wall_clock().unwrap_or_default().as_nanos();
        let head = LineHead {
            stamp: u64::try_from(since_1970).unwrap_or(u64::MAX),
            level: level.number(),
            logger: rule.logger.named.id,
            site: self.number(),
        };
        rule.logger.log.core().push(&LineDraft::of(text), head);
    }
}
