//! The dispatcher's wait. It ends with the transport's descriptor, the alarm, or the waker.
//! With descriptors; the same without any is in `waiting_disabled.rs`.

use super::transport::Transport;
use crate::Nanos;
use crate::platform::io;
use crate::sync::{AtomicBool, AtomicU64, Ordering};
use replenish_os::timer::TimerFd;
use replenish_os::{PollFd, WaitSet, WakeFd, clock, poll};

/// The wait set of a session.
pub(super) struct Waiting {
    waker: WakeFd,
    /// Waited for by those who are not to be woken.
    nobody: WakeFd,
    alarm: Alarm,
    /// Waker, alarm and transport, where that has one descriptor for ever.
    together: Option<WaitSet>,
    /// When the dispatcher's last wait ended, whether nobody has asked for that yet, and whether it
    /// was soon after the one before.
    ended: AtomicU64,
    fresh: AtomicBool,
    pressed: AtomicBool,
}

/// Waits that end more often than this are for one message of many.
const OFTEN: Nanos = 50_000;

/// The waker's bit in the set, and that of the others.
const WAKER: u32 = 1;
const OTHERS: u32 = 2;

/// The session's next deadline. A publisher that makes it earlier sets it itself.
pub(super) struct Alarm(TimerFd);

impl Waiting {
    pub(super) fn new(transport: &dyn Transport) -> io::Result<Self> {
        let (waker, alarm) = (WakeFd::new()?, Alarm(TimerFd::new()?));
        let together = match transport.lasting_descriptor() {
            None => None,
            Some(descriptor) => {
                let set = WaitSet::new()?;
                set.add(&waker, WAKER)?;
                set.add(&alarm.0, OTHERS)?;
                set.add(&descriptor, OTHERS)?;
                Some(set)
            }
        };
        Ok(Self {
            waker,
            nobody: WakeFd::new()?,
            alarm,
            together,
            ended: AtomicU64::new(0),
            fresh: AtomicBool::new(false),
            pressed: AtomicBool::new(true),
        })
    }

    pub(super) const fn alarm(&self) -> &Alarm {
        &self.alarm
    }

    /// The transport has nothing of its own to go on with between two messages.
    pub(super) const fn is_for_datagrams(&self) -> bool {
        self.together.is_some()
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
        let woken = match &self.together {
            Some(set) => set.wait(deadline)? & WAKER != 0,
            None => self.wait(&self.waker, transport, deadline)?,
        };
        if woken {
            self.waker.clear();
        }
        let now = clock::monotonic();
        let before = self.ended.swap(now, Ordering::Relaxed);
        let often = now.saturating_sub(before) < OFTEN;
        self.pressed.store(often, Ordering::Relaxed);
        self.fresh.store(true, Ordering::Relaxed);
        Ok(())
    }

    /// When the dispatcher's wait has ended, once per wait: the time need not be looked up again.
    pub(super) fn ended(&self) -> Option<Nanos> {
        let fresh = self.fresh.load(Ordering::Relaxed);
        self.fresh.store(false, Ordering::Relaxed);
        fresh.then(|| self.ended.load(Ordering::Relaxed))
    }

    /// How many messages the dispatcher is to receive before it waits again, up to `most`. After a
    /// sleep there is most often just one: to look for a second costs a system call, and if there
    /// is one the next wait ends at once.
    pub(super) fn batch(&self, most: usize) -> usize {
        if self.pressed.load(Ordering::Relaxed) {
            most
        } else {
            1
        }
    }

    /// Somebody else waits, at set-up.
    pub(super) fn other(&self, transport: &dyn Transport, deadline: Nanos) -> io::Result<()> {
        self.wait(&self.nobody, transport, Some(deadline)).map(drop)
    }

    /// Returns whether `waker` has ended the wait.
    fn wait(
        &self,
        waker: &WakeFd,
        transport: &dyn Transport,
        deadline: Option<Nanos>,
    ) -> io::Result<bool> {
        let mut result = Ok(false);
        let writes = transport.wants_write();
        transport.with_descriptor(&mut |descriptor| {
            let (waker, alarm) = (PollFd::readable(waker), PollFd::readable(&self.alarm.0));
            result = match &descriptor {
                Some(fd) if writes => {
                    let (input, output) = (PollFd::readable(fd), PollFd::writable(fd));
                    first(&mut [waker, alarm, input, output], deadline)
                }
                Some(fd) => first(&mut [waker, alarm, PollFd::readable(fd)], deadline),
                None => first(&mut [waker, alarm], deadline),
            };
        });
        result
    }
}

/// Polls; whether the first of them is ready.
fn first(fds: &mut [PollFd<'_>], deadline: Option<Nanos>) -> io::Result<bool> {
    poll(fds, deadline)?;
    Ok(fds.first().is_some_and(PollFd::is_ready))
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
