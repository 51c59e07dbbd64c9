//! The dispatcher's wait without descriptors. It ends with one signal, which the transport's
//! interrupt, the waker and an alarm that became earlier set.
//!
//! ```text
//!   dispatcher                               publisher
//!   announce "whenever"                      alarm := earlier
//!   until := min(alarm, deadline)            announced later than that? ring
//!   announce until
//!   wait for the signal, or until
//! ```

use super::transport::Transport;
use crate::Nanos;
use crate::platform::io;
use crate::sync::{Arc, AtomicU64, Notify, Ordering};
use replenish_os::clock;
use sporadic::{earliest, later};

/// Period in ns of threads that poll instead of waiting for the signal.
const LOOK: Nanos = 1_000_000;

/// The wait of a session.
pub(super) struct Waiting {
    alarm: Alarm,
}

/// The session's next deadline. A publisher that makes it earlier sets it itself.
pub(super) struct Alarm {
    bell: Arc<Notify>,
    at: AtomicU64,
    /// Until when the dispatcher waits; 0 while it does not.
    waits_until: AtomicU64,
}

impl Waiting {
    #[expect(
        clippy::unnecessary_wraps,
        reason = "the signature of what it stands in for"
    )]
    pub(super) fn new(transport: &dyn Transport) -> io::Result<Self> {
        let bell = Arc::new(Notify::new());
        transport.attach(&bell);
        Ok(Self {
            alarm: Alarm {
                bell,
                at: AtomicU64::new(Nanos::MAX),
                waits_until: AtomicU64::new(0),
            },
        })
    }

    pub(super) const fn alarm(&self) -> &Alarm {
        &self.alarm
    }

    /// The session has nothing to go on with between two messages but what
    /// [`State::receive`](super::state::State::receive) tells: a port is drained by `receive`, and
    /// one without room is told there.
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_for_datagrams(&self) -> bool {
        true
    }

    /// Ends the dispatcher's wait, or its next one.
    pub(super) fn wake(&self) {
        self.alarm.bell.set();
    }

    /// The dispatcher waits.
    pub(super) fn dispatcher(
        &self,
        _transport: &dyn Transport,
        deadline: Option<Nanos>,
    ) -> io::Result<()> {
        let alarm = &self.alarm;
        let deadline = deadline.unwrap_or(Nanos::MAX);
        // From now on an alarm that is set rings, until it is known which ones are early enough.
        alarm.waits_until.store(Nanos::MAX, Ordering::SeqCst);
        let until = alarm.at.load(Ordering::SeqCst).min(deadline);
        alarm.waits_until.store(until, Ordering::SeqCst);
        if until == Nanos::MAX {
            alarm.bell.wait();
        } else {
            alarm.bell.wait_until(until);
        }
        alarm.waits_until.store(0, Ordering::SeqCst);
        Ok(())
    }

    /// When the dispatcher's wait has ended: the clock is cheap here.
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn ended(&self) -> Option<Nanos> {
        None
    }

    /// How many messages the dispatcher is to receive before it waits again: all, since the bell
    /// rings once for several.
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn batch(&self, most: usize) -> usize {
        most
    }

    /// Somebody else waits, at set-up: for a short while, without the signal.
    #[expect(
        clippy::unnecessary_wraps,
        reason = "the signature of what it stands in for"
    )]
    pub(super) fn other(&self, _transport: &dyn Transport, deadline: Nanos) -> io::Result<()> {
        let glance = later(clock::monotonic(), LOOK);
        clock::sleep_until(earliest(glance, deadline));
        Ok(())
    }
}

impl Alarm {
    /// Rings at `at`, and not before, whatever it was set to. `Nanos::MAX`: never.
    #[expect(
        clippy::unnecessary_wraps,
        reason = "the signature of what it stands in for"
    )]
    pub(super) fn set(&self, at: Nanos) -> io::Result<()> {
        self.at.store(at, Ordering::SeqCst);
        if at < self.waits_until.load(Ordering::SeqCst) {
            self.bell.set();
        }
        Ok(())
    }
}
