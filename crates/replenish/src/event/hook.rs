//! The hook that events go to, and its default.

use super::kinds::Event;
use super::logged;
use crate::platform::{self, LOG, STD};
use alloc::boxed::Box;

/// The hook that events go to.
pub(crate) struct Events(Box<dyn Fn(&Event<'_>) + Send + Sync>);

impl Events {
    pub(crate) fn new(hook: impl Fn(&Event<'_>) + Send + Sync + 'static) -> Self {
        Self(Box::new(hook))
    }

    /// A hook that panics ends nothing: the panic hook has said so.
    pub(crate) fn emit(&self, event: &Event<'_>) {
        platform::guard(&mut (), |()| (self.0)(event), |(), _| ());
    }

    /// Emits if `count` is a power of two: the first time, and whenever it has doubled.
    pub(crate) fn emit_rarely(&self, count: u64, event: &Event<'_>) {
        if count.is_power_of_two() {
            self.emit(event);
        }
    }
}

/// The hook's captured values may panic as they are dropped, on whatever thread holds the hook
/// last.
impl Drop for Events {
    fn drop(&mut self) {
        if STD {
            platform::guard(&mut self.0, |hook| *hook = Box::new(|_| ()), |_, _| ());
        }
    }
}

impl Default for Events {
    /// Sends events to the program's logger with feature `log`; else prints one line each on
    /// standard error, where there is one.
    fn default() -> Self {
        if LOG {
            Self::new(logged::tell)
        } else {
            Self::new(|event: &Event<'_>| platform::tell(event))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    #[test]
    fn repeated_events_are_told_when_their_count_doubles() {
        let told = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&told);
        let events = Events::new(move |e| log.lock().unwrap().push(e.to_string()));
        for count in 1..=1000 {
            let handle = "/n/sub:/t";
            events.emit_rarely(
                count,
                &Event::Oversize {
                    handle,
                    size: 9,
                    count,
                },
            );
        }
        let told = told.lock().unwrap();
        assert_eq!(told.len(), 10); // 1, 2, 4, … 512
        assert_eq!(
            told[0],
            "/n/sub:/t: sample of 9 bytes does not fit (1 times): see max_size"
        );
    }
}
