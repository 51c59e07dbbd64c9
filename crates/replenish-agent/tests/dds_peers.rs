//! XRCE clients, the agent, and a DDS that is not ours: Eclipse Cyclone DDS (C, through Python), in
//! the place of a ROS 2 node with `rmw_cyclonedds`. `tests/peers/setup.sh` installs it; without it
//! these trials count as ignored.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

#[path = "support/bridged.rs"]
mod bridged;

#[path = "support/cyclone.rs"]
mod cyclone;

fn main() {
    peers::main();
}

mod peers {
    use super::bridged::{Client, agent, domain, service_client, typed_client};
    use super::cyclone::{self, Cyclone};
    use replenish_agent::{BridgeSnapshot, RunningAgent};
    use replenish_testkit::harness::{peer_trial, run};
    use replenish_xrce::wire::{ObjectKind, StreamId};
    use std::time::{Duration, Instant};

    /// The longest time that any step may take on a busy machine.
    const PATIENCE: Duration = Duration::from_secs(60);

    const STRING: &str = "std_msgs::msg::dds_::String_";

    pub(super) fn main() {
        let missing = cyclone::missing();
        let trial = |name, body: fn()| peer_trial(name, missing.clone(), body);
        run(vec![
            trial("cyclone_echoes_what_a_client_publishes", echo),
            trial(
                "cyclone_that_pauses_longer_than_its_lease_is_served_again",
                pause,
            ),
            trial("cyclone_answers_a_client", cyclone_answers),
            trial("a_client_answers_cyclone", client_answers),
        ]);
    }

    /// Waits until each endpoint in DDS has a peer.
    fn matched(agent: &RunningAgent, topics: &[&str]) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
            let bridge = snapshot.bridge.unwrap();
            let done = |topic: &&str| bridge.iter().any(|b| b.name == *topic && b.matched > 0);
            if topics.iter().all(done) {
                return;
            }
            assert!(Instant::now() < deadline, "in vain: {bridge:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn string(text: &str) -> Vec<u8> {
        let length = u32::try_from(text.len() + 1).unwrap();
        [&length.to_le_bytes(), text.as_bytes(), b"\0"].concat()
    }

    fn echo() {
        for stream in [StreamId::RELIABLE, StreamId::BEST_EFFORT] {
            let domain = domain();
            let agent = agent(domain);
            let reliability = if stream.is_reliable() {
                "reliable"
            } else {
                "best_effort"
            };
            let _cyclone = Cyclone::start(domain, &["echo", reliability]);
            let topics = ("rt/chatter", "rt/echo");
            // One publishes and listens, another one only listens.
            let mut one = typed_client(&agent, 1, STRING, topics, stream);
            let mut two = typed_client(&agent, 2, STRING, ("rt/other", "rt/echo"), stream);
            matched(&agent, &["rt/chatter", "rt/echo"]);
            warm_up(stream, &mut one, &mut two);
            for i in 0..100 {
                one.write(stream, &string(&format!("hello {i}")));
                let expected = string(&format!("echo of hello {i}"));
                for client in [&mut one, &mut two] {
                    let got = heard(client);
                    assert!(
                        got.starts_with(&expected),
                        "{}",
                        String::from_utf8_lossy(&got)
                    );
                }
            }
            let stats = agent.stop().unwrap();
            assert_eq!((stats.bridge_dropped, stats.samples_dropped), (0, 0));
        }
    }

    /// Until Cyclone has found our readers, which nothing tells us, its echoes are lost.
    fn warm_up(stream: StreamId, one: &mut Client, two: &mut Client) {
        one.got.clear();
        two.got.clear();
        let deadline = Instant::now() + PATIENCE;
        while one.got.is_empty() || two.got.is_empty() {
            assert!(Instant::now() < deadline, "no echo");
            one.write(stream, &string("warm up"));
            one.idle(Duration::from_millis(50));
            two.idle(Duration::from_millis(50));
        }
    }

    /// The next echo, but for those of samples that were sent until both knew each other.
    fn heard(client: &mut Client) -> Vec<u8> {
        loop {
            let got = client.read();
            let is_early = |text: &str| {
                let early = string(&format!("echo of {text}"));
                got.starts_with(&early)
            };
            if !is_early("warm up") && !is_early("unheard") {
                return got;
            }
        }
    }

    /// A program that its debugger stops, or that a network cuts off, is not lost for good.
    fn pause() {
        let domain = domain();
        let agent = agent(domain);
        let cyclone = Cyclone::start(domain, &["echo", "reliable"]);
        let stream = StreamId::RELIABLE;
        let mut one = typed_client(&agent, 1, STRING, ("rt/chatter", "rt/echo"), stream);
        let mut two = typed_client(&agent, 2, STRING, ("rt/other", "rt/echo"), stream);
        matched(&agent, &["rt/chatter", "rt/echo"]);
        for round in 1..=2 {
            warm_up(stream, &mut one, &mut two);
            cyclone.signal("STOP");
            let deadline = Instant::now() + PATIENCE;
            while row(&agent, "rt/chatter").counts.lost < round {
                assert!(Instant::now() < deadline, "the lease is never over");
                one.write(stream, &string("unheard"));
                one.idle(Duration::from_millis(50));
            }
            cyclone.signal("CONT");
            // Matched in both directions, within the time that discovery takes.
            warm_up(stream, &mut one, &mut two);
            for i in 0..100 {
                one.write(stream, &string(&format!("{round} {i}")));
                let expected = string(&format!("echo of {round} {i}"));
                for client in [&mut one, &mut two] {
                    let got = heard(client);
                    assert!(
                        got.starts_with(&expected),
                        "{} for {round} {i}",
                        String::from_utf8_lossy(&got)
                    );
                }
            }
            let counts = |topic| row(&agent, topic).counts;
            let (writer, reader) = (counts("rt/chatter"), counts("rt/echo"));
            assert_eq!((writer.lost, writer.returned), (round, round), "{writer:?}");
            assert_eq!((reader.lost, reader.returned), (round, round), "{reader:?}");
            assert!(writer.unheard > 0, "{writer:?}");
            println!("unheard, at most: {}", writer.unheard);
        }
        let stats = agent.stop().unwrap();
        assert_eq!((stats.bridge_dropped, stats.samples_dropped), (0, 0));
    }

    /// The agent's row about a topic in DDS.
    fn row(agent: &RunningAgent, topic: &str) -> BridgeSnapshot {
        let snapshot = agent.inspector().snapshot(Duration::from_secs(5)).unwrap();
        let mut bridge = snapshot.bridge.unwrap().into_iter();
        bridge.find(|row| row.name == topic).unwrap()
    }

    fn cyclone_answers() {
        let domain = domain();
        let agent = agent(domain);
        let _cyclone = Cyclone::start(domain, &["replier"]);
        let mut client = service_client(&agent, 1, ObjectKind::Requester);
        for i in 0..50_i64 {
            let request = client.request(&[i.to_le_bytes(), 7_i64.to_le_bytes()].concat());
            let sum = (i + 7).to_le_bytes().to_vec();
            assert_eq!(client.reply(), (request, sum));
        }
        agent.stop().unwrap();
    }

    fn client_answers() {
        let domain = domain();
        let agent = agent(domain);
        let mut client = service_client(&agent, 1, ObjectKind::Replier);
        let mut cyclone = Cyclone::start(domain, &["requester", "50"]);
        for _ in 0..50 {
            let asked = client.read();
            let (identity, request) = asked.split_at(24);
            let number = |at: usize| {
                let bytes = request[at..at + 8].try_into().unwrap();
                i64::from_le_bytes(bytes)
            };
            let sum = (number(0) + number(8)).to_le_bytes();
            client.write(StreamId::RELIABLE, &[identity, &sum].concat());
        }
        cyclone.says("done");
        agent.stop().unwrap();
    }
}
