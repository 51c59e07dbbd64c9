//! SIGINT and SIGTERM as a flag and a wake-up: every command ends cleanly on them. SIGUSR1 asks a
//! command that goes on for ever what it is doing, SIGHUP to read its files again.

use crate::outcome::Failure;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// "Please end": set by a signal, or by the process that supervises this one.
///
/// [`is_triggered`](Self::is_triggered) takes no lock. Threads of different priorities look at it:
/// one that is lowered while it holds a lock would keep all the others waiting.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    stopped: AtomicBool,
    /// Whether a question was asked; guards changes of `stopped`, too.
    asked: Mutex<bool>,
    /// Whether files are to be read again; changes under `asked`.
    reload: AtomicBool,
    changed: Condvar,
}

/// Reason why a wait has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Woken {
    /// The end was asked for.
    Stopped,
    /// A signal asks for the status.
    Asked,
    /// Files are to be read again.
    Reload,
    /// The time is over.
    Time,
}

impl Stop {
    /// A stop that SIGINT and SIGTERM trigger.
    ///
    /// # Errors
    /// The kernel refuses the handlers.
    pub fn on_signals() -> Result<Self, Failure> {
        Self::on(&[SIGINT, SIGTERM])
    }

    /// The same, and SIGUSR1 [asks](Woken::Asked).
    ///
    /// # Errors
    /// The kernel refuses the handlers.
    pub fn on_signals_and_questions() -> Result<Self, Failure> {
        Self::on(&[SIGINT, SIGTERM, SIGUSR1])
    }

    /// The same, and SIGHUP asks to read files [again](Woken::Reload).
    ///
    /// # Errors
    /// The kernel refuses the handlers.
    pub fn on_signals_questions_and_reloads() -> Result<Self, Failure> {
        Self::on(&[SIGINT, SIGTERM, SIGUSR1, SIGHUP])
    }

    fn on(signals: &[i32]) -> Result<Self, Failure> {
        let stop = Self::default();
        let mut signals = Signals::new(signals)
            .map_err(|e| Failure::refused(format!("cannot handle signals: {e}")))?;
        let trigger = stop.clone();
        std::thread::spawn(move || {
            for signal in signals.forever() {
                match signal {
                    SIGUSR1 => trigger.change(|asked| *asked = true),
                    SIGHUP => trigger.change(|_| trigger.0.reload.store(true, Ordering::Release)),
                    _ => trigger.trigger(),
                }
            }
        });
        Ok(stop)
    }

    /// Asks for the end.
    pub fn trigger(&self) {
        self.change(|_| self.0.stopped.store(true, Ordering::Release));
    }

    fn change(&self, how: impl FnOnce(&mut bool)) {
        how(&mut self.0.asked.lock().unwrap_or_else(PoisonError::into_inner));
        self.0.changed.notify_all();
    }

    /// Whether the end was asked for.
    pub fn is_triggered(&self) -> bool {
        self.0.stopped.load(Ordering::Acquire)
    }

    /// Waits until the end is asked for, a question is, or `limit` is over. Takes the question.
    pub fn wait_or_asked(&self, limit: Duration) -> Woken {
        let guard = self.0.asked.lock().unwrap_or_else(PoisonError::into_inner);
        let reload = || self.0.reload.load(Ordering::Acquire);
        let quiet = |asked: &mut bool| !self.is_triggered() && !*asked && !reload();
        let waited = self.0.changed.wait_timeout_while(guard, limit, quiet);
        let (mut asked, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if !self.is_triggered() && self.0.reload.swap(false, Ordering::AcqRel) {
            return Woken::Reload;
        }
        match (self.is_triggered(), std::mem::take(&mut *asked)) {
            (true, _) => Woken::Stopped,
            (false, true) => Woken::Asked,
            (false, false) => Woken::Time,
        }
    }

    /// Waits until the end is asked for.
    pub fn wait_forever(&self) {
        while !self.wait(Duration::from_secs(3_600)) {}
    }

    /// Waits until the end is asked for, at most `limit`; returns whether it was.
    pub fn wait(&self, limit: Duration) -> bool {
        let guard = self.0.asked.lock().unwrap_or_else(PoisonError::into_inner);
        let quiet = |_: &mut bool| !self.is_triggered();
        let waited = self.0.changed.wait_timeout_while(guard, limit, quiet);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        self.is_triggered()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread at low priority may hold the lock for long. On b209253 a busy worker waited for it:
    /// budgets in pieces and 539 wakes of the enforcer per second in `bench enforcement`.
    #[test]
    fn to_look_takes_no_lock() {
        let stop = Stop::default();
        let held = stop.0.asked.lock().unwrap();
        assert!(!stop.is_triggered());
        drop(held);
        stop.trigger();
        assert!(stop.is_triggered());
        assert!(stop.wait(Duration::from_secs(3_600)));
        assert_eq!(
            stop.wait_or_asked(Duration::from_secs(3_600)),
            Woken::Stopped
        );
    }
}
