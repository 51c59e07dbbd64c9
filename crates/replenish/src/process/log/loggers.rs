//! The log of a context: its thread, from the first logger on.

use super::core::Core;
use super::writer;
use replenish_args::RosArgs;
use replenish_os::{Thread, ThreadSpec, spawn};
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};

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
        if let Some(thread) = self.thread.take() {
            thread.join().ok();
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
