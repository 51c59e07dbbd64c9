//! Which clients have returned from the agent before this one.

use crate::clients::ClientOrigin;
use replenish_xrce::Nanos;

/// So long after a returned client's last request it has created all its readers.
const MOMENT: Nanos = 300_000_000;

/// Who has returned from the agent before this one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RecoveryWindow {
    /// Until when clients may return; counted from the agent's first moment.
    pub(super) until: Option<Nanos>,
    /// How many have.
    returned: usize,
    /// How many there were, as far as those who have returned know.
    expected: u8,
    /// Clients that are told what is settled, up to 255.
    pub(super) here: u8,
    /// When they have created their readers.
    pub(super) equipped: Option<Nanos>,
}

impl RecoveryWindow {
    /// A client has sent something in its session: it will create its readers now.
    pub(super) fn arrived(&mut self, now: Nanos, origin: Option<ClientOrigin>) {
        if let Some(ClientOrigin::Returned(companions)) = origin {
            self.returned += 1;
            self.expected = self.expected.max(companions);
            self.equips(now);
        }
    }

    /// One of them creates something.
    pub(super) fn equips(&mut self, now: Nanos) {
        self.equipped = Some(now.saturating_add(MOMENT));
    }

    /// Whether one that says that there were `companions` need not wait for others any more.
    pub(super) fn is_over(&self, now: Nanos, companions: u8) -> bool {
        let all = companions > 0 && self.returned >= usize::from(companions);
        let late = |time: Option<Nanos>| time.is_none_or(|time| time <= now);
        late(self.until) || (all && late(self.equipped))
    }

    /// How many clients will return should this agent be lost now.
    pub(super) fn companions(&self, now: Nanos) -> u8 {
        let more = self.until.filter(|until| now < *until);
        more.map_or(self.here, |_| self.here.max(self.expected))
    }

    /// When it may be over for somebody.
    pub(super) fn deadline(&self) -> Option<Nanos> {
        self.equipped.into_iter().chain(self.until).min()
    }
}
