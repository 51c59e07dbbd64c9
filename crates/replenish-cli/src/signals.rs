//! SIGINT and SIGTERM as a flag and a wake-up: every command ends cleanly on them. SIGUSR1 asks a
//! command that goes on for ever what it is doing.

use crate::outcome::Failure;
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// "Please end": set by a signal, or by whoever supervises this process.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<(Mutex<State>, Condvar)>);

#[derive(Debug, Default)]
struct State {
    stopped: bool,
    asked: bool,
}

/// Why a wait has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Woken {
    /// The end was asked for.
    Stopped,
    /// Somebody wants to know what is going on.
    Asked,
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

    fn on(signals: &[i32]) -> Result<Self, Failure> {
        let stop = Self::default();
        let mut signals = Signals::new(signals)
            .map_err(|e| Failure::refused(format!("cannot handle signals: {e}")))?;
        let trigger = stop.clone();
        std::thread::spawn(move || {
            for signal in signals.forever() {
                if signal == SIGUSR1 {
                    trigger.change(|state| state.asked = true);
                } else {
                    trigger.trigger();
                }
            }
        });
        Ok(stop)
    }

    /// Asks for the end.
    pub fn trigger(&self) {
        self.change(|state| state.stopped = true);
    }

    fn change(&self, how: impl FnOnce(&mut State)) {
        how(&mut self.0.0.lock().unwrap_or_else(PoisonError::into_inner));
        self.0.1.notify_all();
    }

    /// Whether the end was asked for.
    pub fn is_triggered(&self) -> bool {
        let state = self.0.0.lock();
        state.unwrap_or_else(PoisonError::into_inner).stopped
    }

    /// Waits until the end is asked for, a question is, or `limit` is over. Takes the question.
    pub fn wait_or_asked(&self, limit: Duration) -> Woken {
        let guard = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        let quiet = |state: &mut State| !state.stopped && !state.asked;
        let waited = self.0.1.wait_timeout_while(guard, limit, quiet);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match (state.stopped, std::mem::take(&mut state.asked)) {
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
        let guard = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (guard, _) = self
            .0
            .1
            .wait_timeout_while(guard, limit, |state| !state.stopped)
            .unwrap_or_else(PoisonError::into_inner);
        guard.stopped
    }
}
