//! SIGINT and SIGTERM: the first ends the executors that asked for it, a second one the process.
//!
//! ```text
//!   signal ──► handler: armed? the default, at once
//!                 └─ no: thread "signals" ──► stop of each watched executor ──► armed after 0.3 s
//! ```
//!
//! A launcher passes on a Ctrl-C that the terminal has sent to the program as well, so signals that
//! come together count as one. No handler is installed before the program asks for it.

use crate::error::Error;
use crate::executor::StopHandle;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::Signals;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

const SIGNALS: [i32; 2] = [SIGINT, SIGTERM];
/// Signals that come within this time of the first are the same wish.
const TOGETHER: Duration = Duration::from_millis(300);

struct Process {
    ended: Arc<AtomicBool>,
    watched: Mutex<(u64, Vec<(u64, StopHandle)>)>,
}

static PROCESS: OnceLock<Result<Process, String>> = OnceLock::new();

fn process() -> Option<&'static Process> {
    PROCESS.get().and_then(|process| process.as_ref().ok())
}

/// Whether a signal has asked this process to end.
pub(super) fn ended() -> bool {
    process().is_some_and(|process| process.ended.load(Ordering::Acquire))
}

/// Whether the executors of one context end by signals.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ends(Arc<AtomicBool>);

impl Ends {
    /// Installs the handlers: signals end these executors from now on.
    pub(super) fn ask(&self) -> Result<(), Error> {
        let installed = PROCESS.get_or_init(|| install().map_err(|e| e.to_string()));
        if let Err(reason) = installed {
            return Err(Error::Thread {
                name: "signals".into(),
                reason: reason.clone(),
            });
        }
        self.0.store(true, Ordering::Release);
        Ok(())
    }

    /// Calls `stop` at the signal, or at once if it has come, as long as the result lives.
    pub(crate) fn watch(&self, stop: &StopHandle) -> Watched {
        let Some(process) = process().filter(|_| self.0.load(Ordering::Acquire)) else {
            return Watched(None);
        };
        let mut watched = process.lock();
        watched.0 += 1;
        let number = watched.0;
        if ended() {
            stop.stop();
        }
        watched.1.push((number, stop.clone()));
        Watched(Some(number))
    }
}

/// An executor that ends by signals.
#[derive(Debug)]
pub(crate) struct Watched(Option<u64>);

impl Drop for Watched {
    fn drop(&mut self) {
        if let (Some(number), Some(process)) = (self.0, process()) {
            process.lock().1.retain(|(n, _)| *n != number);
        }
    }
}

impl Process {
    fn lock(&self) -> MutexGuard<'_, (u64, Vec<(u64, StopHandle)>)> {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn install() -> io::Result<Process> {
    let ended = Arc::new(AtomicBool::new(false));
    let armed = Arc::new(AtomicBool::new(false));
    // The thread's end of it first: a signal between the two would be lost otherwise.
    let mut signals = Signals::new(SIGNALS)?;
    for signal in SIGNALS {
        flag::register_conditional_default(signal, Arc::clone(&armed))?;
        flag::register(signal, Arc::clone(&ended))?;
    }
    let work = move || {
        for _ in signals.forever() {
            if let Some(process) = process() {
                process.lock().1.iter().for_each(|(_, stop)| stop.stop());
            }
            std::thread::sleep(TOGETHER);
            armed.store(true, Ordering::Release);
        }
    };
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(work)?;
    Ok(Process {
        ended,
        watched: Mutex::new((0, Vec::new())),
    })
}
