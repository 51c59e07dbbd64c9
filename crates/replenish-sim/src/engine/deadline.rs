//! Wakes and throttles threads of `SCHED_DEADLINE` and gives them runtime again, as
//! [`Cbs`](super::cbs) decides.

use super::phase::Phase;
use super::simulation::{Sim, Timer};
use crate::{End, Nanos, What};

impl Sim<'_> {
    /// The thread became runnable.
    pub(super) fn wake_deadline(&mut self, id: usize) {
        let now = self.now;
        let Some(cbs) = &mut self.states[id].cbs else {
            return;
        };
        let before = cbs.throttled;
        cbs.wake(now);
        if cbs.throttled && !before {
            self.set_unthrottle(id);
        }
    }

    /// Throttles a thread whose runtime is used up; true if it was.
    pub(super) fn throttle(&mut self, id: usize) -> bool {
        let now = self.now;
        let state = &mut self.states[id];
        let Some(cbs) = &mut state.cbs else {
            return false;
        };
        if cbs.left > 0 || cbs.throttled {
            return false;
        }
        let overrun = Nanos::try_from(-cbs.left).unwrap_or(Nanos::MAX);
        state.out.worst_overrun = state.out.worst_overrun.max(overrun);
        state.out.exhaustions += 1;
        if cbs.next_period() <= now {
            cbs.replenish(now);
            self.refresh(id, End::Tail);
        } else {
            cbs.throttled = true;
            self.note(id, What::Throttle);
            self.refresh(id, End::Tail);
            self.set_unthrottle(id);
        }
        true
    }

    fn set_unthrottle(&mut self, id: usize) {
        if let Some(cbs) = &mut self.states[id].cbs {
            let at = cbs.next_period();
            cbs.unthrottle_at = Some(at);
            self.set_timer(at, id, Timer::Unthrottle { at });
        }
    }

    /// The timer that was set for `at` has expired.
    pub(super) fn unthrottle(&mut self, id: usize, at: Nanos) {
        let now = self.now;
        let state = &mut self.states[id];
        let Some(cbs) = &mut state.cbs else {
            return;
        };
        if cbs.unthrottle_at != Some(at) {
            return;
        }
        cbs.unthrottle_at = None;
        if state.phase == Phase::Ready || state.phase == Phase::Blocked || cbs.left <= 0 {
            cbs.replenish(now);
        } else {
            cbs.throttled = false;
        }
        state.out.replenishments += 1;
        self.note(id, What::Unthrottle);
        self.refresh(id, End::Tail);
    }
}
