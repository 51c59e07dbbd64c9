//! The agent on TCP and on serial lines: real sockets, pseudo-terminals, noise.

use crate::wire::{Carrier, Live};
use replenish_agent::{Agent, AgentConfig, AgentError, Limits, RunningAgent, SerialConfig};
use replenish_os::tty::Pty;
use replenish_xrce::wire::StreamId;
use std::net::{Ipv4Addr, TcpStream};
use std::time::{Duration, Instant};

const BOTH: [StreamId; 2] = [StreamId::BEST_EFFORT, StreamId::RELIABLE];

fn config() -> AgentConfig {
    AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        tcp: Some((Ipv4Addr::LOCALHOST, 0).into()),
        ..AgentConfig::default()
    }
}

fn start(config: &AgentConfig) -> RunningAgent {
    Agent::bind(config).unwrap().spawn().unwrap()
}

/// Waits for something the agent does by itself.
fn eventually(what: &str, done: impl Fn() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while !done() {
        assert!(Instant::now() < deadline, "in vain: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A written sample comes back to the writer itself.
fn echo(live: &mut Live, stream: StreamId, payload: &[u8]) {
    live.got.clear();
    live.write(stream, payload);
    live.until(|live| !live.got.is_empty());
    assert_eq!(live.got, [payload]);
}

#[test]
fn samples_pass_over_tcp_short_and_in_fragments() {
    let agent = start(&config());
    for stream in BOTH {
        let carrier = Carrier::tcp(agent.tcp_addr().unwrap());
        let mut live = Live::open(carrier, 1, "loop", "loop", stream);
        for i in 0..100_u8 {
            echo(&mut live, stream, &[i; 30]);
        }
        if stream == StreamId::RELIABLE {
            let long: Vec<u8> = (0..4000_u32).map(|i| i as u8).collect();
            echo(&mut live, stream, &long);
        }
    }
    let stats = agent.stop().unwrap();
    assert_eq!(
        (stats.malformed, stats.bad_frames, stats.send_failed),
        (0, 0, 0)
    );
    assert_eq!(stats.samples_out, 201);
}

#[test]
fn many_connections_and_a_sample_for_all() {
    let agent = start(&config());
    let addr = agent.tcp_addr().unwrap();
    let mut lives: Vec<Live> = (1..=20)
        .map(|key| Live::open(Carrier::tcp(addr), key, "all", "all", StreamId::RELIABLE))
        .collect();
    lives[7].write(StreamId::RELIABLE, b"hello");
    for live in &mut lives {
        live.until(|live| live.got == [b"hello"]);
    }
    let snapshot = agent.inspector().snapshot(Duration::from_secs(10)).unwrap();
    assert_eq!(snapshot.clients.len(), 20);
    let first = snapshot.client("01010101").unwrap();
    assert!(first.peer.starts_with("tcp 127.0.0.1:"), "{}", first.peer);
    let readers = first.entities.iter().filter_map(|entity| entity.reader);
    assert_eq!(
        readers
            .map(|r| (r.delivered, r.matched))
            .collect::<Vec<_>>(),
        [(1, 20)]
    );
}

#[test]
fn a_connection_that_ends_takes_its_sessions_with_it() {
    let agent = start(&config());
    let addr = agent.tcp_addr().unwrap();
    let live = Live::open(Carrier::tcp(addr), 1, "a", "b", StreamId::RELIABLE);
    assert_eq!(agent.stats().clients, 1);
    drop(live);
    eventually("the session ends", || agent.stats().clients == 0);
    assert_eq!(agent.stats().clients_lost, 1);
    let mut again = Live::open(Carrier::tcp(addr), 1, "a", "a", StreamId::RELIABLE);
    echo(&mut again, StreamId::RELIABLE, b"back");
}

#[test]
fn connections_are_limited_and_nonsense_on_one_harms_nobody() {
    let mut config = config();
    config.limits = Limits {
        clients: 3,
        silence: 1_000_000_000,
        ..Limits::default()
    };
    let agent = start(&config);
    let addr = agent.tcp_addr().unwrap();
    let mut live = Live::open(Carrier::tcp(addr), 1, "a", "a", StreamId::RELIABLE);
    let mut silent: Vec<TcpStream> = (0..4).map(|_| TcpStream::connect(addr).unwrap()).collect();
    eventually("two are too many", || {
        agent.stats().connections_refused == 2
    });
    std::io::Write::write_all(&mut silent[0], &[0xff; 3000]).unwrap();
    std::io::Write::write_all(&mut silent[1], &[3, 0, 1, 2, 3, 1]).unwrap();
    eventually("it is nonsense", || agent.stats().malformed > 0);
    // A silent client is disconnected; the session that is asked for signs of life is not.
    let deadline = Instant::now() + Duration::from_millis(2500);
    while Instant::now() < deadline {
        live.turn(50_000_000);
    }
    drop(silent);
    echo(&mut live, StreamId::RELIABLE, b"fine");
    let mut next = Live::open(Carrier::tcp(addr), 2, "a", "a", StreamId::RELIABLE);
    echo(&mut next, StreamId::RELIABLE, b"room");
}

/// On b209253 one byte per `--silence` kept a connection without log-in alive, and with it a place:
/// with all places taken no other client could connect any more.
#[test]
fn connections_on_which_nobody_logs_in_keep_no_places() {
    let mut config = config();
    config.limits.clients = 3;
    let agent = start(&config);
    let addr = agent.tcp_addr().unwrap();
    let mut drips: Vec<TcpStream> = (0..3).map(|_| TcpStream::connect(addr).unwrap()).collect();
    let mut drip = move || {
        let sent = drips
            .iter_mut()
            .map(|drip| std::io::Write::write(drip, &[1]).is_ok());
        sent.filter(|sent| *sent).count()
    };
    for _ in 0..8 {
        drip();
        std::thread::sleep(Duration::from_millis(200));
    }
    let mut live = Live::open(Carrier::tcp(addr), 1, "a", "a", StreamId::RELIABLE);
    echo(&mut live, StreamId::RELIABLE, b"room");
    // The others go by themselves, although something comes on them all the time.
    let deadline = Instant::now() + Duration::from_secs(60);
    while drip() > 0 {
        assert!(Instant::now() < deadline);
        live.turn(100_000_000);
    }
    echo(&mut live, StreamId::RELIABLE, b"fine");
    let kinds: Vec<_> = agent.inspector().rejections().list;
    let closed = kinds
        .iter()
        .filter(|r| r.reason.kind() == "no_log_in")
        .count();
    assert_eq!(closed, 3, "{kinds:?}");
}

/// A client that does not read its connection holds up no other. The agent drops its samples when
/// the queue is full.
#[test]
fn a_connection_that_takes_nothing_holds_up_nobody() {
    let agent = start(&config());
    let addr = agent.tcp_addr().unwrap();
    let stuck = Live::open(Carrier::tcp(addr), 1, "x", "flood", StreamId::BEST_EFFORT);
    let mut live = Live::open(Carrier::tcp(addr), 2, "flood", "x", StreamId::BEST_EFFORT);
    let dropped = || agent.stats().samples_dropped;
    let deadline = Instant::now() + Duration::from_secs(60);
    while dropped() < 1000 {
        for _ in 0..100 {
            live.write(StreamId::BEST_EFFORT, &[7; 400]);
        }
        assert!(Instant::now() < deadline, "{:?}", agent.stats());
    }
    let mut other = Live::open(Carrier::tcp(addr), 3, "o", "o", StreamId::RELIABLE);
    echo(&mut other, StreamId::RELIABLE, b"fine");
    assert_eq!(agent.stats().send_failed, 0, "kept where the oldest can go");
    drop(stuck);
}

/// A pseudo-terminal, and an agent at its other end.
fn line() -> (RunningAgent, Pty) {
    let pty = Pty::open().unwrap();
    let config = AgentConfig {
        serial: vec![SerialConfig::new(pty.path())],
        ..config()
    };
    (start(&config), pty)
}

#[test]
fn samples_pass_over_a_serial_line() {
    let (agent, pty) = line();
    let carrier = Carrier::serial(pty.tty, 1, 0);
    let mut live = Live::open(carrier, 1, "loop", "loop", StreamId::RELIABLE);
    for i in 0..=255_u8 {
        echo(&mut live, StreamId::RELIABLE, &[i; 40]);
    }
    let all: Vec<u8> = (0..2000_u32).map(|i| i as u8).collect();
    echo(&mut live, StreamId::RELIABLE, &all);
    let snapshot = agent.inspector().snapshot(Duration::from_secs(10)).unwrap();
    assert_eq!(snapshot.clients[0].peer, "serial line 0 address 1");
    let stats = agent.stop().unwrap();
    assert_eq!((stats.bad_frames, stats.samples_out), (0, 257));
}

/// One byte in 500 is changed, lost or put in, both ways: nothing wrong is delivered, nothing is
/// lost on a reliable stream, everything in order and once.
#[test]
fn a_noisy_line_delivers_everything_unharmed() {
    let (agent, pty) = line();
    let carrier = Carrier::serial(pty.tty, 1, 500);
    let mut live = Live::open(carrier, 1, "loop", "loop", StreamId::RELIABLE);
    let sample = |i: u32| -> Vec<u8> { (0..60).map(|at| (i * 31 + at * 7) as u8).collect() };
    for i in 0..300 {
        live.write(StreamId::RELIABLE, &sample(i));
        // The reader keeps the last 100.
        live.until(|live| live.got.len() + 50 > i as usize);
    }
    live.until(|live| live.got.len() >= 300);
    let expected: Vec<Vec<u8>> = (0..300).map(sample).collect();
    assert_eq!(live.got, expected);
    let stats = agent.stop().unwrap();
    assert!(
        stats.bad_frames > 20 && stats.retransmitted > 5,
        "{stats:?}"
    );
    assert_eq!(stats.clients_created, 1, "the session lasts");
}

#[test]
fn a_client_is_answered_at_its_own_address() {
    let (agent, pty) = line();
    let mut one = Live::open(Carrier::serial(pty.tty, 5, 0), 1, "loop", "loop", BOTH[1]);
    echo(&mut one, StreamId::RELIABLE, b"five");
    let stats = agent.inspector().snapshot(Duration::from_secs(10)).unwrap();
    assert_eq!(stats.clients[0].peer, "serial line 0 address 5");
}

#[test]
fn a_line_that_ends_takes_its_sessions_with_it_and_the_agent_goes_on() {
    let (agent, pty) = line();
    let live = Live::open(
        Carrier::serial(pty.tty, 1, 0),
        1,
        "a",
        "b",
        StreamId::RELIABLE,
    );
    drop(live);
    eventually("the session ends", || agent.stats().clients == 0);
    let carrier = Carrier::tcp(agent.tcp_addr().unwrap());
    let mut other = Live::open(carrier, 2, "a", "a", StreamId::RELIABLE);
    echo(&mut other, StreamId::RELIABLE, b"fine");
}

/// The device's name is a link to the plugged device, as in `/dev/serial/by-id`.
#[test]
fn a_line_that_is_back_is_opened_again() {
    let files = replenish_testkit::program::Scratch::new("serial-back");
    let name = files.path("tty");
    let plug = || {
        let pty = Pty::open().unwrap();
        std::fs::remove_file(&name).ok();
        std::os::unix::fs::symlink(pty.path(), &name).unwrap();
        pty
    };
    let first = plug();
    let config = AgentConfig {
        serial: vec![SerialConfig::new(&name)],
        ..config()
    };
    let agent = start(&config);
    let open = |pty: Pty| {
        let carrier = Carrier::serial(pty.tty, 1, 0);
        Live::open(carrier, 1, "loop", "loop", StreamId::RELIABLE)
    };
    drop(open(first));
    eventually("the session ends", || agent.stats().clients == 0);
    let mut live = open(plug());
    echo(&mut live, StreamId::RELIABLE, b"back");
}

#[test]
fn a_line_that_cannot_be_opened_is_named() {
    let with = |serial| AgentConfig {
        serial: vec![serial],
        ..config()
    };
    let error = Agent::bind(&with(SerialConfig::new("/nowhere/tty"))).unwrap_err();
    assert!(matches!(error, AgentError::Serial { .. }));
    let text = error.to_string();
    assert!(
        text.starts_with("cannot open serial line /nowhere/tty: "),
        "{text}"
    );
    let odd = SerialConfig {
        baud: 7,
        ..SerialConfig::new("/dev/null")
    };
    let text = Agent::bind(&with(odd)).unwrap_err().to_string();
    assert!(
        text.starts_with("serial.baud is 7, allowed is 1200, "),
        "{text}"
    );
}
