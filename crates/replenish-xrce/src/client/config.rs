//! Settings and storage of a session.

use crate::Nanos;
use crate::stream::{AckPolicy, Reliability};
use crate::wire::{ClientKey, Properties, SessionId, StreamId};

/// Settings of a session. All times are in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Identifies this client to the agent; no two clients of an agent may have the same.
    pub key: ClientKey,
    /// The first session id; later sessions count up from it. From 0x81 on the key is not part of
    /// every message, which is what the agent expects on UDP and serial lines.
    pub session: SessionId,
    /// Log in again under the same session id. An agent that has the session yet keeps its objects;
    /// what is still under way from before can then be taken for the new session's.
    pub reuse: bool,
    /// The reliable stream that requests go on; those of other streams do not delay them.
    pub requests: StreamId,
    /// Pairs of name and value for the agent, 100 bytes in all with 10 more for each pair; what is
    /// longer, and any without the feature `delivery`, is not sent and counted in
    /// [`LinkStats::properties_omitted`](super::LinkStats::properties_omitted).
    pub properties: Properties<'static>,
    /// Asks the agent, with one more property, to distinguish samples that it has received from
    /// samples that have reached all their readers. The client keeps samples until the latter, so
    /// an agent that dies loses none. An agent that does not know this ignores it;
    /// `replenish-agent` does know it. Of the other properties the first seven are sent then.
    /// Without the feature `delivery` the client does not ask.
    pub confirm_delivery: bool,
    /// The longest message in bytes, both ways: 64..=65507 on UDP. micro-ROS has 512. The log-in
    /// tells it to the agent, which sends none longer; so it is to be what the transport and both
    /// sides can carry.
    pub mtu: u16,
    /// Time until a log-in that was not answered is sent again; doubles up to `retry_max`.
    pub retry_first: Nanos,
    /// The longest time between log-ins. Must exceed the round trip to the agent.
    pub retry_max: Nanos,
    /// The longest time in ns until the next answer of a present agent to the creation of objects.
    /// A request without an answer is then
    /// [`RequestState::Unanswered`](super::RequestState::Unanswered), and a session that waits for
    /// it to be up waits no longer.
    pub answer_within: Nanos,
    /// Pings by which the client notices the loss of the agent; `None`: never.
    pub ping: Option<PingPolicy>,
    /// Heartbeats and window of the reliable output streams.
    pub reliability: Reliability,
    /// Acknowledgement policy of reliable input streams.
    pub acks: AckPolicy,
}

/// Pings by which the client notices the loss of the agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PingPolicy {
    /// Ping after that long without a message from the agent, and again after each half of it: with
    /// the defaults, one of eight pings has to be answered.
    pub after: Nanos,
    /// The agent counts as lost after that long without a message, the last `silence_limit - after`
    /// of it with pings.
    pub silence_limit: Nanos,
}

impl Config {
    /// The defaults, for client `key`: session 0x81, MTU 512, log-in every 0.2 s to 0.5 s, 5 s for
    /// answers, ping after 0.14 s of silence and every 0.07 s from then on, loss after 0.7 s.
    #[must_use]
    pub fn new(key: ClientKey) -> Self {
        Config {
            key,
            session: SessionId(0x81),
            reuse: false,
            requests: StreamId::RELIABLE,
            properties: Properties::None,
            confirm_delivery: false,
            mtu: 512,
            retry_first: 200_000_000,
            retry_max: 500_000_000,
            answer_within: 5_000_000_000,
            ping: Some(PingPolicy {
                after: 140_000_000,
                silence_limit: 700_000_000,
            }),
            reliability: Reliability::default(),
            acks: AckPolicy::IMMEDIATE,
        }
    }
}

/// Storage of a session with `B` best-effort and `R` reliable streams each way; lengths are free,
/// the comments say what follows from them.
#[derive(Debug)]
pub struct Buffers<S, const B: usize = 1, const R: usize = 1> {
    /// Buffers of the best-effort streams, one message each: length at least `mtu`.
    pub best_effort: [S; B],
    /// The reliable streams.
    pub reliable: [ReliableBuffers<S>; R],
    /// The journal of created objects: about 30 bytes and the names for each.
    pub journal: S,
    /// Requests on their way after a new log-in, `length / mtu` messages of them: with room for at
    /// least one, samples that were not acknowledged when the agent was lost are sent again; with
    /// less, or without the feature `delivery`, they are given up and counted. Then a request must
    /// fit in it.
    pub restore: S,
}

/// Storage of one reliable stream, both ways.
#[derive(Debug)]
pub struct ReliableBuffers<S> {
    /// The messages sent and not acknowledged: `length / mtu` of them, at most the session's `N`.
    pub output: S,
    /// Buffer for one sample that is too large for the free part of `output`, with 8 bytes more and
    /// padded to a multiple of four; may be empty, then the largest sample fills `output`.
    pub large_output: S,
    /// The messages that wait for a missing one: `length / mtu` of them, at most `N`.
    pub input: S,
    /// The largest sample that can be received in fragments, plus 8 bytes.
    pub fragments: S,
}
