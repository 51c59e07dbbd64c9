//! What the dispatcher's wait ends with: the transport's descriptor, the alarm, and the waker.
//! With descriptors; the same without any is in `waiting_bare.rs`.

use super::Transport;
use crate::Nanos;
use crate::platform::io;
use replenish_os::timer::TimerFd;
use replenish_os::{PollFd, WakeFd, poll};

/// What a session waits on.
pub(super) struct Waiting {
    waker: WakeFd,
    /// Waited for by those who are not to be woken.
    nobody: WakeFd,
    alarm: Alarm,
}

/// The session's next deadline. A publisher that makes it earlier sets it itself.
pub(super) struct Alarm(TimerFd);

impl Waiting {
    pub(super) fn new(_transport: &dyn Transport) -> io::Result<Self> {
        Ok(Self {
            waker: WakeFd::new()?,
            nobody: WakeFd::new()?,
            alarm: Alarm(TimerFd::new()?),
        })
    }

    pub(super) const fn alarm(&self) -> &Alarm {
        &self.alarm
    }

    /// Ends the dispatcher's wait, or its next one.
    pub(super) fn wake(&self) {
        self.waker.wake();
    }

    /// The dispatcher waits.
    pub(super) fn dispatcher(
        &self,
        transport: &dyn Transport,
        deadline: Option<Nanos>,
    ) -> io::Result<()> {
        self.wait(&self.waker, transport, deadline)?;
        self.waker.clear();
        Ok(())
    }

    /// Somebody else waits, at set-up.
    pub(super) fn other(&self, transport: &dyn Transport, deadline: Nanos) -> io::Result<()> {
        self.wait(&self.nobody, transport, Some(deadline))
    }

    fn wait(
        &self,
        waker: &WakeFd,
        transport: &dyn Transport,
        deadline: Option<Nanos>,
    ) -> io::Result<()> {
        let mut result = Ok(0);
        let writes = transport.wants_write();
        transport.with_descriptor(&mut |descriptor| {
            let (waker, alarm) = (PollFd::readable(waker), PollFd::readable(&self.alarm.0));
            result = match &descriptor {
                Some(fd) if writes => {
                    let (input, output) = (PollFd::readable(fd), PollFd::writable(fd));
                    poll(&mut [waker, alarm, input, output], deadline)
                }
                Some(fd) => poll(&mut [waker, alarm, PollFd::readable(fd)], deadline),
                None => poll(&mut [waker, alarm], deadline),
            };
        });
        result.map(|_| ())
    }
}

impl Alarm {
    /// Rings at `at`, and not before, whatever it was set to. `Nanos::MAX`: never.
    pub(super) fn set(&self, at: Nanos) -> io::Result<()> {
        if at == Nanos::MAX {
            self.0.disarm()
        } else {
            self.0.arm(at)
        }
    }
}
