//! The agent on a real socket: two clients on loopback, the address, stopping.

use replenish_agent::{
    Agent, AgentConfig, AgentError, Limits, RunningAgent, StopHandle, TopicRule,
};
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

fn config() -> AgentConfig {
    AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        ..AgentConfig::default()
    }
}

fn start() -> RunningAgent {
    Agent::bind(&config()).unwrap().spawn().unwrap()
}

/// `GET_INFO` without a session, and the first bytes of the answer.
fn ping(agent: &RunningAgent) {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let get_info = [0x80, 0, 0, 0, 2, 1, 8, 0, 0, 0x0a, 0xff, 0xfd, 2, 0, 0, 0];
    socket.send_to(&get_info, agent.local_addr()).unwrap();
    let mut buf = [0; 100];
    let (len, _) = socket.recv_from(&mut buf).unwrap();
    assert_eq!(len, 36);
    assert_eq!(buf[..8], [0x80, 0, 0, 0, 6, 1, 28, 0]);
}

#[test]
fn a_ping_is_answered() {
    let agent = start();
    ping(&agent);
    ping(&agent);
    // The counters are published after the answer has left.
    let deadline = Instant::now() + Duration::from_secs(60);
    while agent.stats().datagrams_out < 2 && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(agent.stats().datagrams_out, 2);
}

#[test]
fn an_address_in_use_is_named() {
    let agent = start();
    let taken = AgentConfig {
        addr: agent.local_addr(),
        ..AgentConfig::default()
    };
    let error = Agent::bind(&taken).unwrap_err();
    assert!(matches!(error, AgentError::AddressInUse(addr) if addr == agent.local_addr()));
    let text = error.to_string();
    assert!(
        text.starts_with(&format!("address {} is in use", agent.local_addr())),
        "{text}"
    );

    agent.stop().unwrap();
    Agent::bind(&taken).expect("the address is free again");
}

#[test]
fn an_address_of_another_host_is_named() {
    // TEST-NET-1 (RFC 5737) belongs to no host.
    let config = AgentConfig {
        addr: ([192, 0, 2, 1], 8888).into(),
        ..AgentConfig::default()
    };
    let text = Agent::bind(&config).unwrap_err().to_string();
    assert!(
        text.starts_with("cannot listen at 192.0.2.1:8888: "),
        "{text}"
    );
}

/// Without a wake-up each stop would take a second.
fn stops_at_once(config: &AgentConfig) {
    let before = Instant::now();
    for _ in 0..20 {
        Agent::bind(config)
            .unwrap()
            .spawn()
            .unwrap()
            .stop()
            .unwrap();
    }
    assert!(
        before.elapsed() < Duration::from_secs(10),
        "woken, not timed out"
    );
}

#[test]
fn an_idle_agent_stops_at_once() {
    stops_at_once(&config());
}

#[test]
fn an_agent_on_all_addresses_stops_at_once() {
    let addr = (Ipv4Addr::UNSPECIFIED, 0).into();
    stops_at_once(&AgentConfig {
        addr,
        ..AgentConfig::default()
    });
}

#[test]
fn stopping_before_running_is_not_lost() {
    let mut agent = Agent::bind(&config()).unwrap();
    let stop = StopHandle::new();
    stop.stop();
    agent.run(&stop).unwrap();
    assert!(stop.is_stopped());
}

#[test]
fn one_handle_stops_several_agents() {
    let stop = StopHandle::new();
    let threads = [(); 2].map(|()| {
        let (mut agent, stop) = (Agent::bind(&config()).unwrap(), stop.clone());
        std::thread::spawn(move || agent.run(&stop))
    });
    std::thread::sleep(Duration::from_millis(50));
    stop.stop();
    for thread in threads {
        thread.join().unwrap().unwrap();
    }
}

#[test]
fn clients_that_vanish_do_not_end_it() {
    let agent = start();
    for _ in 0..50 {
        // Closed before the answer comes: the kernel says "connection refused" to the agent.
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let get_info = [0x80, 0, 0, 0, 2, 1, 8, 0, 0, 0x0a, 0xff, 0xfd, 2, 0, 0, 0];
        socket.send_to(&get_info, agent.local_addr()).unwrap();
    }
    ping(&agent);
    assert!(agent.is_running());
}

#[test]
fn settings_out_of_range_are_named() {
    let limits = Limits {
        clients: 0,
        ..Limits::default()
    };
    let wrong = [
        AgentConfig { limits, ..config() },
        AgentConfig {
            rules: vec![TopicRule::new("*", 8)],
            ..config()
        },
    ];
    let texts = wrong.map(|config| Agent::bind(&config).unwrap_err().to_string());
    assert_eq!(
        texts,
        [
            "limits.clients is 0, allowed is 1 to 4096",
            "rules.priority is 8, allowed is 0 to 7"
        ]
    );
}

#[test]
fn a_running_agent_tells_what_it_does_and_others_do_not() {
    let agent = Agent::bind(&config()).unwrap();
    let inspector = agent.inspector();
    assert_eq!(inspector.snapshot(Duration::from_millis(10)), None);
    let agent = agent.spawn().unwrap();
    ping(&agent);
    let first = inspector.snapshot(Duration::from_secs(10)).unwrap();
    assert_eq!((first.stats.datagrams_in, first.clients.len()), (1, 0));
    std::thread::sleep(Duration::from_millis(2));
    let second = inspector.snapshot(Duration::from_secs(10)).unwrap();
    assert!(second.seconds_since(&first) >= 0.002);
    agent.stop().unwrap();
    assert_eq!(inspector.snapshot(Duration::from_millis(10)), None);
}
