//! Participants of others that were silent for longer than their lease, and come back.
//!
//! RustDDS drops the matches of a silent participant. When the participant is heard again, RustDDS
//! puts its readers and writers back into its list, but matches them with new endpoints only. So a
//! second endpoint is opened on the topic for a moment: RustDDS then offers the readers or writers
//! on the list to every endpoint of that topic, and the old endpoints match again.
//!
//! ```text
//!   lease over ──► AWAY ── discovered again, GRACE ──► DUE ── reminder ──► matched: gone
//!                    ▲                                  │ ▲       │
//!                    └──── silent once more ────────────┘ └─ AGAIN┘ at most TRIES times
//! ```

use crate::domain::{Domain, Reader, Writer};
use crate::endpoint::{EndpointKind, Id, Topic};
use crate::open_endpoint::OpenEndpoint;
use crate::qos::{Qos, WINDOW};
use rustdds::GUID;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Readers and writers of others that are remembered; the oldest is forgotten for a newer one.
const MAX_AWAY: usize = 4096;

/// The time that RustDDS and the participant have for matching by themselves.
const GRACE: Duration = Duration::from_secs(1);

/// The time between two reminders for the same reader or writer, and their number. One that is not
/// matched after all of them does not exist any more.
const AGAIN: Duration = Duration::from_secs(2);
const TRIES: u8 = 5;

/// How long a reminder is open: the event loop of RustDDS has to see it.
const OPEN: Duration = Duration::from_millis(500);

/// How often the clock is looked at while something is due.
const TICK: Duration = Duration::from_millis(100);

/// A reader or writer of a silent participant, and the endpoint it was matched with.
struct Away {
    of: Id,
    guid: GUID,
    /// It is a reader; otherwise a writer.
    reads: bool,
    /// The samples that the endpoint had sent when the match was lost.
    sent: u64,
    /// The time of the next reminder, once the participant is there again.
    due: Option<Instant>,
    tries: u8,
}

/// The second endpoint on a topic.
struct Reminder {
    until: Instant,
    _endpoint: (Option<Writer>, Option<Reader>),
}

/// The readers and writers that may come back.
#[derive(Default)]
pub(crate) struct Returns {
    away: Vec<Away>,
    reminders: Vec<Reminder>,
}

impl Returns {
    /// The participant of these readers and writers was silent for too long: `live` loses them.
    pub(crate) fn lost(&mut self, of: Id, live: &mut OpenEndpoint, gone: impl Fn(&GUID) -> bool) {
        for (guid, reads) in live
            .matches()
            .filter(|(guid, _)| gone(guid))
            .collect::<Vec<_>>()
        {
            live.counts.lost += 1;
            if reads {
                // Those on the way are not repeated.
                live.counts.unheard += live.sent.min(WINDOW);
            }
            if self.away.len() >= MAX_AWAY {
                self.away.remove(0);
            }
            self.away.push(Away {
                of,
                guid,
                reads,
                sent: live.sent,
                due: None,
                tries: 0,
            });
        }
    }

    /// A participant is there, perhaps again; `is_of` says which readers and writers are its own.
    pub(crate) fn discovered(&mut self, is_of: impl Fn(&GUID) -> bool) {
        let due = Some(Instant::now() + GRACE);
        for away in self.away.iter_mut().filter(|away| is_of(&away.guid)) {
            (away.due, away.tries) = (due, 0);
        }
    }

    /// An endpoint is matched with this reader or writer.
    pub(crate) fn matched(&mut self, of: Id, live: &mut OpenEndpoint, guid: GUID) {
        self.away.retain(|away| {
            let back = away.of == of && away.guid == guid;
            if back {
                live.counts.returned += 1;
                if away.reads {
                    live.counts.unheard += live.sent.saturating_sub(away.sent);
                }
            }
            !back
        });
    }

    /// This reader or writer does not exist any more.
    pub(crate) fn gone(&mut self, guid: GUID) {
        self.away.retain(|away| away.guid != guid);
    }

    /// How long the thread may wait; `None` for as long as it wants.
    pub(crate) fn timeout(&self) -> Option<Duration> {
        let due = self.away.iter().any(|away| away.due.is_some());
        (due || !self.reminders.is_empty()).then_some(TICK)
    }

    /// Opens the reminders that are due, one for each topic and direction, and closes old ones.
    pub(crate) fn remind(
        &mut self,
        domains: &mut BTreeMap<u16, Domain>,
        live: &BTreeMap<Id, OpenEndpoint>,
    ) {
        let now = Instant::now();
        self.reminders.retain(|reminder| reminder.until > now);
        let mut reminded: Vec<(u16, &Topic, bool)> = Vec::new();
        self.away.retain_mut(|away| {
            if away.due.is_none_or(|due| due > now) {
                return true;
            }
            let Some(endpoint) = live.get(&away.of).filter(|_| away.tries < TRIES) else {
                return false;
            };
            (away.due, away.tries) = (Some(now + AGAIN), away.tries + 1);
            let (topic, qos) = place(&endpoint.kind, away.reads);
            let (number, reads) = (endpoint.domain, away.reads);
            if reminded.contains(&(number, topic, reads)) {
                return true;
            }
            reminded.push((number, topic, reads));
            let Some(domain) = domains.get_mut(&number) else {
                return false;
            };
            let endpoint = if reads {
                (domain.writer(topic, &qos).ok(), None)
            } else {
                (None, domain.reader(topic, &qos).ok())
            };
            self.reminders.push(Reminder {
                until: now + OPEN,
                _endpoint: endpoint,
            });
            true
        });
    }
}

/// The topic and QoS of the half of an endpoint that talks to readers, or to writers.
fn place(kind: &EndpointKind, reads: bool) -> (&Topic, Qos) {
    match kind {
        EndpointKind::Writer { topic, qos } | EndpointKind::Reader { topic, qos } => (topic, *qos),
        EndpointKind::Requester { request, reply } | EndpointKind::Replier { request, reply } => {
            let asks = matches!(kind, EndpointKind::Requester { .. });
            let topic = if asks == reads { request } else { reply };
            (topic, Qos::default())
        }
    }
}
