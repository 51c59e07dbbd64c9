//! An agent with a bridge: its clients get any datagrams, and the other side does what it likes
//! with the endpoints that it knows.

use super::Script;
use super::agent::{Agent, LIMITS};
use replenish_agent::{AgentConfig, AgentCore, BridgeEvent, BridgeId, BridgeKind, BridgeSample};
use replenish_agent::{ros_topic, ros_type};
use std::collections::BTreeMap;

/// Topic names of a domain.
const NAMES: usize = 16;

/// The other side.
#[derive(Default)]
pub(crate) struct Other {
    /// Nodes, which are `false`, and endpoints that are open.
    open: BTreeMap<BridgeId, bool>,
    last: BridgeId,
}

/// An agent under fire from both sides.
pub(crate) struct Bridged {
    agent: Agent,
    other: Other,
}

impl Bridged {
    /// Carries out a script from its beginning.
    pub(crate) fn run(script: &[u8]) {
        let core = AgentCore::with(&AgentConfig {
            limits: LIMITS,
            ..AgentConfig::default()
        });
        let mut world = Self {
            agent: Agent::of(core.bridged(0, NAMES)),
            other: Other::default(),
        };
        let mut script = Script(script);
        while !script.is_empty() {
            world.step(&mut script);
        }
        world.agent.end();
        world.take();
        let open = &world.other.open;
        assert!(open.is_empty(), "nobody is left, and open are {open:?}");
    }

    fn step(&mut self, script: &mut Script<'_>) {
        match script.byte() {
            op if op % 4 > 0 => self.agent.step(script),
            op => {
                let id = self.pick(script.byte());
                match op / 4 % 4 {
                    0 | 1 => {
                        let request = match script.byte() {
                            0 => None,
                            byte => Some(([byte; 16], i64::from(byte) - 128)),
                        };
                        let sample = BridgeSample::new(script.run().to_vec(), request);
                        let now = self.agent.at();
                        self.agent.core.from_bridge(now, id, &sample);
                    }
                    2 => self.agent.core.served_beyond(id, op & 16 == 0),
                    _ => self.agent.core.incompatible_beyond(id, op),
                }
                self.agent.pump();
            }
        }
        self.take();
    }

    /// One that is open, or was, or never will be.
    fn pick(&self, byte: u8) -> BridgeId {
        let open = self.other.open.keys().nth(usize::from(byte));
        open.copied().unwrap_or(u64::from(byte))
    }

    /// Takes what the agent tells the other side, which makes sense.
    fn take(&mut self) {
        let mut samples = 0;
        while let Some(event) = self.agent.core.poll_bridge() {
            match event {
                BridgeEvent::Node { id, .. } => self.other.opened(id, false),
                BridgeEvent::Endpoint { id, node, kind, .. } => {
                    let known = node.is_none_or(|node| self.other.open.get(&node) == Some(&false));
                    assert!(known, "a node that is not there");
                    self.other.opened(id, true);
                    let topics = match &kind {
                        BridgeKind::Writer(topic, _) | BridgeKind::Reader(topic, _) => {
                            [topic, topic]
                        }
                        BridgeKind::Requester(ask, answer) | BridgeKind::Replier(ask, answer) => {
                            [ask, answer]
                        }
                    };
                    for topic in topics {
                        drop((ros_topic(&topic.name), ros_type(&topic.type_name)));
                    }
                }
                BridgeEvent::Close { id } => assert!(self.other.open.remove(&id).is_some()),
                BridgeEvent::Sample { id, sample } => {
                    assert_eq!(self.other.open.get(&id), Some(&true), "of nobody");
                    assert!(sample.payload().len() <= LIMITS.sample);
                    samples += 1;
                }
            }
        }
        assert!(samples <= 1024);
        assert!(self.other.open.len() <= LIMITS.clients * LIMITS.entities);
    }
}

impl Other {
    fn opened(&mut self, id: BridgeId, endpoint: bool) {
        assert!(id > self.last, "an id is used once");
        self.last = id;
        self.open.insert(id, endpoint);
    }
}
