//! Times to log in, to ping and to give up: the part of a session that is about the agent's
//! presence.

use super::{Config, PingPolicy};
use crate::counter::count;
use crate::time::{NEVER, Nanos, later};
use crate::wire::SessionId;

/// State of a session with its agent. See the module's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionState {
    /// No session is wanted.
    Idle,
    /// Logging in.
    Connecting,
    /// Logged in; objects are being created anew.
    Restoring,
    /// Logged in, objects as they were.
    Up,
    /// Logging out.
    Closing,
}

/// The counters of a session's link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LinkStats {
    /// Log-ins sent.
    pub logins: u64,
    /// Sessions that were up.
    pub sessions: u64,
    /// Times the agent was lost.
    pub losses: u64,
    /// Reliable messages that were not acknowledged when the agent was lost.
    pub unacknowledged: u64,
    /// Samples that were not acknowledged in one session and are sent again in the next one. Some
    /// of them may have arrived before: their acknowledgement may be what was lost.
    pub carried: u64,
    /// Reliable samples that were taken and given up: by a log-out, or for want of
    /// [`Buffers::restore`](super::Buffers::restore).
    pub lost: u64,
    /// Log-ins without the properties, which were too long.
    pub properties_omitted: u64,
    /// Requests and replies of services that were too short to be any.
    pub malformed: u64,
    /// Pings sent.
    pub pings: u64,
    /// Datagrams that were malformed or not of this session.
    pub rejected: u64,
}

/// Timers and state of the link.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) state: SessionState,
    pub(super) session: SessionId,
    pub(super) stats: LinkStats,
    /// Time to send the next log-in or log-out.
    next_request: Nanos,
    retry: Nanos,
    /// Log-ins or log-outs sent in this state.
    attempts: u32,
    heard: Nanos,
    next_ping: Nanos,
    /// The first ping since the agent was heard.
    first_ping: Nanos,
}

impl Link {
    /// Log-outs that are sent before the session counts as closed.
    const LOGOUTS: u32 = 3;

    pub(super) const fn new(config: &Config) -> Self {
        Link {
            state: SessionState::Idle,
            session: config.session,
            stats: LinkStats {
                logins: 0,
                sessions: 0,
                losses: 0,
                unacknowledged: 0,
                carried: 0,
                lost: 0,
                properties_omitted: 0,
                malformed: 0,
                pings: 0,
                rejected: 0,
            },
            next_request: 0,
            retry: config.retry_first,
            attempts: 0,
            heard: 0,
            next_ping: 0,
            first_ping: NEVER,
        }
    }

    /// Enters `state`, whose first request is due at once.
    #[cfg_attr(not(feature = "std"), inline(never))]
    pub(super) const fn enter(&mut self, now: Nanos, state: SessionState, config: &Config) {
        self.state = state;
        self.next_request = now;
        self.retry = config.retry_first;
        self.attempts = 0;
    }

    /// The agent was heard.
    pub(super) const fn hear(&mut self, now: Nanos) {
        self.heard = now;
        self.first_ping = NEVER;
    }

    /// Time at which the next ping is due.
    const fn ping_at(&self, ping: &PingPolicy) -> Nanos {
        match self.first_ping {
            NEVER => later(self.heard, ping.after),
            _ => self.next_ping,
        }
    }

    /// Whether a log-in (log-out) is due; if so it counts as sent. The second one and later ones
    /// use the next session id.
    pub(super) fn take_request(&mut self, now: Nanos, config: &Config) -> bool {
        if !matches!(self.state, SessionState::Connecting | SessionState::Closing)
            || now < self.next_request
        {
            return false;
        }
        if self.state == SessionState::Connecting {
            if self.stats.logins > 0 && !config.reuse {
                self.session = next_session(self.session);
            }
            count(&mut self.stats.logins);
        }
        self.attempts = self.attempts.saturating_add(1);
        self.next_request = later(now, self.retry);
        self.retry = later(self.retry, self.retry).min(config.retry_max);
        true
    }

    /// Whether a ping is due; if so it counts as sent.
    pub(super) fn take_ping(&mut self, now: Nanos, config: &Config) -> bool {
        let Some(ping) = config
            .ping
            .filter(|ping| self.has_session() && now >= self.ping_at(ping))
        else {
            return false;
        };
        self.next_ping = later(now, ping.after / 2);
        if self.first_ping == NEVER {
            self.first_ping = now;
        }
        count(&mut self.stats.pings);
        true
    }

    /// Whether the agent has been silent for too long.
    pub(super) fn is_lost(&self, now: Nanos, config: &Config) -> bool {
        self.has_session() && now >= self.silent_at(config)
    }

    /// Whether the agent did not answer the last log-out either.
    pub(super) const fn gave_up_closing(&self, now: Nanos) -> bool {
        matches!(self.state, SessionState::Closing)
            && self.attempts >= Self::LOGOUTS
            && now >= self.next_request
    }

    /// Time at which the agent was last heard of.
    pub(super) const fn heard(&self) -> Nanos {
        self.heard
    }

    pub(super) const fn has_session(&self) -> bool {
        matches!(self.state, SessionState::Restoring | SessionState::Up)
    }

    /// Time at which there is something to do; [`NEVER`] for no time.
    pub(super) fn deadline(&self, config: &Config) -> Nanos {
        match self.state {
            SessionState::Idle => NEVER,
            SessionState::Connecting | SessionState::Closing => self.next_request,
            SessionState::Restoring | SessionState::Up => match &config.ping {
                Some(ping) => self.ping_at(ping).min(self.silent_at(config)),
                None => NEVER,
            },
        }
    }

    /// Time at which the agent counts as lost. Only the time in which it could have answered a ping
    /// counts, not the time in which the caller did not look after the session.
    fn silent_at(&self, config: &Config) -> Nanos {
        match config.ping {
            Some(ping) if self.first_ping != NEVER => {
                let patience = ping.silence_limit.saturating_sub(ping.after);
                later(self.first_ping, patience)
            }
            _ => NEVER,
        }
    }
}

/// The session id after `id`, with the same answer to "is the key in the header".
fn next_session(id: SessionId) -> SessionId {
    let number = (id.0 & 0x7f).wrapping_add(1) & 0x7f;
    SessionId(id.before_login().0 | number.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn session_ids_count_up_and_keep_their_kind() {
        assert_eq!(next_session(SessionId(0x81)), SessionId(0x82));
        assert_eq!(next_session(SessionId(0xff)), SessionId(0x81));
        assert_eq!(next_session(SessionId(0x7f)), SessionId(0x01));
        assert_eq!(next_session(SessionId(0x01)), SessionId(0x02));
    }
}
