//! The log of a context: its thread, from the first logger on.

use super::core::Core;
use super::writer;
use replenish_args::RosArgs;
use replenish_os::{Thread, ThreadSpec, clock, spawn};
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};

/// After this long without a line that could be written, in ns, a log that ends gives up.
const STILL: u64 = 2_000_000_000;

/// The log of a context. Its thread ends with it, when all lines are written.
pub(super) struct Log {
    core: Arc<Core>,
    thread: Option<Thread<()>>,
}

impl Log {
    fn start(args: &RosArgs) -> Arc<Self> {
        let core = Arc::new(Core::new(args.log()));
        let theirs = Arc::clone(&core);
        let colours = args.environment().colours;
        let console = args
            .log()
            .stdout
            .then(|| writer::Console::from_env(colours));
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

    pub(super) fn core(&self) -> &Arc<Core> {
        &self.core
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        self.core.ended.store(true, Ordering::Release);
        self.core.notify.set();
        let Some(mut thread) = self.thread.take() else {
            return;
        };
        let mut written = self.core.written.load(Ordering::Acquire);
        while let Err(same) = thread.join_until(clock::monotonic().saturating_add(STILL)) {
            let now = self.core.written.load(Ordering::Acquire);
            if now == written {
                return; // nobody reads the console: the thread ends with the process
            }
            (thread, written) = (same, now);
        }
    }
}

/// A context's log, which begins with the first logger.
#[derive(Default)]
pub(crate) struct Loggers(OnceLock<Arc<Log>>);

impl Loggers {
    pub(super) fn log(&self, args: &RosArgs) -> &Arc<Log> {
        self.0.get_or_init(|| Log::start(args))
    }

    /// Waits until the lines up to now are written, up to a second.
    pub(crate) fn flush(&self) {
        if let Some(log) = self.0.get().filter(|log| log.thread.is_some()) {
            log.core.flush();
        }
    }
}
