//! The agent's counters, which other threads read while it runs.

use std::sync::atomic::{AtomicU64, Ordering};

macro_rules! counters {
    ($($(#[$meta:meta])+ $name:ident,)*) => {
        /// A snapshot of an agent's counters. All but `clients` only grow.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize))]
        #[non_exhaustive]
        pub struct Stats {
            $($(#[$meta])+ pub $name: u64,)*
        }

        /// The counters themselves: one writer (the agent), any number of readers.
        #[derive(Debug, Default)]
        pub(crate) struct Counters {
            $(pub(crate) $name: Counter,)*
        }

        impl Counters {
            /// The values now. Each is exact; together they may be from slightly different times.
            pub(crate) fn snapshot(&self) -> Stats {
                Stats { $($name: self.$name.get(),)* }
            }
        }
    };
}

counters! {
    /// Clients known now.
    clients,
    /// Sessions opened.
    clients_created,
    /// Sessions ended because a client with the same key, or at the same place, opened a newer one.
    clients_replaced,
    /// Sessions ended for a log-in while there were as many as there may be: unused ones, and those
    /// of addresses and hosts that have more than half of the places.
    clients_displaced,
    /// Log-ins refused, and sessions ended, because of the access list.
    denied,
    /// Sessions that went to another address with the same key, because theirs did not answer.
    takeovers,
    /// Log-ins refused because the session of their key answers at another address.
    takeovers_refused,
    /// Sessions ended because the client was silent for too long.
    clients_reaped,
    /// Sessions ended because the client's connection did.
    clients_lost,
    /// Datagrams received.
    datagrams_in,
    /// Datagrams sent.
    datagrams_out,
    /// Datagrams dropped, whole or from some byte on, because they are not XRCE.
    malformed,
    /// Datagrams dropped because no session was opened at their address.
    no_session,
    /// Datagrams dropped because their sender, or all senders without a session, sent too many.
    rate_limited,
    /// Frames on serial lines and TCP dropped because they are damaged, cut or too long.
    bad_frames,
    /// TCP connections closed at once because there are too many.
    connections_refused,
    /// Handshakes of DTLS and TLS refused, whatever the reason.
    handshakes_refused,
    /// Submessages ignored because this agent does not know or support them.
    unsupported,
    /// Requests answered with an error status.
    refused,
    /// Replies dropped because too many of them wait.
    replies_dropped,
    /// Samples that clients wrote.
    samples_in,
    /// Samples put into a reader's queue, once per reader.
    samples_routed,
    /// Samples handed to a stream towards a client.
    samples_out,
    /// Samples that left a reader's queue unsent because a newer one needed the room.
    samples_dropped,
    /// Samples dropped because they are too large, or because too many bytes wait already.
    samples_refused,
    /// Samples that left a reader's queue unsent because their lifespan was over.
    samples_expired,
    /// Samples that a reader did not want because they came too soon after the one before.
    samples_filtered,
    /// Samples that came later after the one before than their writer had promised.
    deadlines_missed,
    /// Pairs of a writer and a reader of one topic that do not talk because of their QoS, counted
    /// when the second of them is created.
    qos_mismatches,
    /// Requests that were forgotten without a reply, because too many newer ones waited.
    calls_forgotten,
    /// Replies dropped because no requester waits for them (any more).
    replies_unwanted,
    /// Samples handed to the bridge to another middleware.
    bridge_out,
    /// Samples that came from the bridge, each for one reader.
    bridge_in,
    /// Samples dropped because the bridge did not ask for them.
    bridge_dropped,
    /// Times that the bridge left out a participant, an endpoint or a match of others, since as
    /// many as there may be were known.
    bridge_left_out,
    /// Reliable messages acknowledged before they had reached all their readers, because one of
    /// these took too long.
    #[cfg_attr(feature = "serde", serde(rename = "settled_late"))]
    confirmed_late,
    /// Samples that waited for a reader when it was deleted or its client's session ended.
    samples_orphaned,
    /// Messages not taken because a keep-all reader has no room; the client sends them again.
    held_back,
    /// Datagrams sent again because a client missed them.
    retransmitted,
    /// Datagrams that the operating system did not take.
    send_failed,
}

/// A number with one writer.
#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    /// Adds one.
    pub(crate) fn hit(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// Adds `n`.
    pub(crate) fn add(&self, n: u64) {
        self.0.fetch_add(n, Ordering::Relaxed);
    }

    /// Sets the value.
    pub(crate) fn set(&self, value: usize) {
        self.0.store(value as u64, Ordering::Relaxed);
    }

    /// The value.
    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}
