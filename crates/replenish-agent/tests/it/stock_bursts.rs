//! The traffic of eProsima's client, replayed: that client cannot be had here (neither a Debian nor
//! a Python package has it).

use crate::stock_client::{At, bursts};
use replenish_agent::{Agent, AgentConfig};
use replenish_xrce::wire::StreamId;
use std::net::Ipv4Addr;
use std::time::Duration;

/// Samples of a run.
const SAMPLES: usize = 3000;

/// On b209253 a reader that keeps the last 10 lost 30 of each burst of 40 over TCP, 753 of 3000
/// arrived, and with a longer queue all, 24 ms late in the median. Prints the counts.
#[test]
fn a_stock_client_s_bursts_arrive_at_one_kilohertz() {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        tcp: Some((Ipv4Addr::LOCALHOST, 0).into()),
        ..AgentConfig::default()
    };
    let agent = Agent::bind(&config).unwrap().spawn().unwrap();
    println!("| transport | stream | arrived | median |\n|---|---|---|---|");
    let cases = [
        (true, StreamId::RELIABLE),
        (true, StreamId::BEST_EFFORT),
        (false, StreamId::RELIABLE),
        (false, StreamId::BEST_EFFORT),
    ];
    for (key, (tcp, stream)) in (1..).step_by(2).zip(cases) {
        let at = if tcp {
            At::Tcp(agent.tcp_addr().unwrap())
        } else {
            At::Udp(agent.local_addr())
        };
        let (arrived, median) = bursts(at, key, stream, SAMPLES, Duration::from_secs(60));
        let transport = if tcp { "TCP" } else { "UDP" };
        let reliable = if stream.is_reliable() {
            "reliable"
        } else {
            "best effort"
        };
        println!("| {transport} | {reliable} | {arrived} of {SAMPLES} | {median:?} |");
        assert_eq!(arrived, SAMPLES);
    }
    assert_eq!(agent.stats().samples_dropped, 0);
}
