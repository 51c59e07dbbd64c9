//! The time in which clients return from the agent before this one.

use crate::clients::ClientOrigin;
use replenish_xrce::Nanos;

/// The time after a returned client's last request in which it creates its readers.
const EQUIP_TIME: Nanos = 300_000_000;

/// The clients that have returned from the agent before this one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RecoveryWindow {
    /// The end of the window, counted from the agent's first event.
    pub(super) until: Option<Nanos>,
    /// The number of returned clients.
    returned: usize,
    /// The number of clients that the previous agent had, by what the returned ones know.
    expected: u8,
    /// Clients of this agent that ask for confirmations, up to 255.
    pub(super) here: u8,
    /// The time at which the returned clients have created their readers.
    pub(super) equipped: Option<Nanos>,
}

impl RecoveryWindow {
    /// Notes a client's first message in its session: it creates its readers now.
    pub(super) fn arrived(&mut self, now: Nanos, origin: Option<ClientOrigin>) {
        if let Some(ClientOrigin::Returned(companions)) = origin {
            self.returned += 1;
            self.expected = self.expected.max(companions);
            self.note_creation(now);
        }
    }

    /// Notes that a returned client creates an entity.
    pub(super) fn note_creation(&mut self, now: Nanos) {
        self.equipped = Some(now.saturating_add(EQUIP_TIME));
    }

    /// Whether a client that expects `companions` need not wait for other clients any more.
    pub(super) fn is_over(&self, now: Nanos, companions: u8) -> bool {
        let all = companions > 0 && self.returned >= usize::from(companions);
        let late = |time: Option<Nanos>| time.is_none_or(|time| time <= now);
        late(self.until) || (all && late(self.equipped))
    }

    /// The number of clients that will return if this agent is lost now.
    pub(super) fn companions(&self, now: Nanos) -> u8 {
        let more = self.until.filter(|until| now < *until);
        more.map_or(self.here, |_| self.here.max(self.expected))
    }

    /// The next time at which the window may end for a client.
    pub(super) fn deadline(&self) -> Option<Nanos> {
        self.equipped.into_iter().chain(self.until).min()
    }
}
