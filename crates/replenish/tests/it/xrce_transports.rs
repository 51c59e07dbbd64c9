//! The XRCE adapter over TCP, over a pseudo-terminal, and over a transport of the user's own.

use crate::common::agent::TestAgent;
use crate::common::bridge::Bridge;
use crate::common::{eventually, executor};
use replenish::middleware::LinkState;
use replenish::middleware::xrce::{Received, Sent, Transport, Xrce, XrceConfig};
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{Context, Qos};
use replenish_agent::{AgentConfig, SerialConfig};
use replenish_os::clock;
use replenish_testkit::watchdog::watchdog;
use replenish_xrce::client::PingPolicy;
use replenish_xrce::udp::UdpTransport;
use std::io;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);

/// `config`, for clients that do not take a loaded machine for a lost agent. Everything arrives,
/// and once, as long as the session lives; what is queued for a client that logs in anew is lost
/// (`docs/acknowledged.md`), and what it had not known to be acknowledged comes twice.
fn patient(config: XrceConfig) -> XrceConfig {
    XrceConfig {
        ping: PingPolicy {
            after: 1_000_000_000,
            silence_limit: 60_000_000_000,
        },
        connect_timeout: 60_000_000_000,
        request_timeout: 60_000_000_000,
        ..config
    }
}

fn over_tcp(agent: SocketAddr) -> Context {
    let config = patient(XrceConfig::default());
    Context::new(Xrce::tcp_with(&agent.to_string(), config).unwrap())
}

fn over_serial(line: &Path) -> Context {
    let config = patient(XrceConfig::slow_line());
    Context::new(Xrce::serial_with(line, 115_200, config).unwrap())
}

/// Publishes `samples` numbers, every seventh with a large array, and expects all of them back.
fn all_come_back(ctx: &Context, samples: i32) {
    let qos = Qos::reliable().keep_all(32);
    let node = ctx.node("echo").unwrap();
    let numbers = node.publisher::<Int32>("numbers", qos).unwrap();
    let arrays = node
        .publisher::<UInt8MultiArray>("arrays", qos.real_time())
        .unwrap();
    let heard = Arc::new(Mutex::new((Vec::new(), 0)));
    let (mut exec, _) = executor(ctx);
    exec.stop_grace(LIMIT); // whoever comes next needs the context
    let (sink, other) = (Arc::clone(&heard), Arc::clone(&heard));
    exec.worker("numbers")
        .subscribe(&node, "numbers", qos, move |m: &Int32, _| {
            sink.lock().unwrap().0.push(m.data);
        })
        .unwrap()
        .subscribe(
            &node,
            "arrays",
            qos.real_time(),
            move |m: &UInt8MultiArray, _| {
                assert!(m.data.len() == 1500 && m.data.iter().all(|byte| *byte == 0x7e));
                other.lock().unwrap().1 += 1;
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let mut array = UInt8MultiArray::default();
    array.data.resize(1500, 0x7e).unwrap();
    let patience = Duration::from_secs(60);
    for data in 0..samples {
        numbers.publish_within(&Int32 { data }, patience).unwrap();
        if data % 7 == 0 {
            arrays.publish_within(&array, patience).unwrap();
        }
    }
    let all: Vec<i32> = (0..samples).collect();
    let count = (samples + 6) / 7;
    assert!(
        eventually(
            || heard.lock().unwrap().0.len() >= all.len() && heard.lock().unwrap().1 >= count
        ),
        "{:?}",
        heard.lock().unwrap()
    );
    assert_eq!(*heard.lock().unwrap(), (all, count));
    running.stop();
}

#[test]
fn tcp_carries_everything_and_a_cut_connection_comes_back() {
    let _dog = watchdog("tcp", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let (bridge, address) = Bridge::tcp(agent.address);
    let ctx = over_tcp(address);
    all_come_back(&ctx, 200);
    let (mut exec, log) = executor(&ctx);
    exec.stop_grace(LIMIT);
    let running = exec.start().unwrap();
    // Samples that have come back are acknowledged; else they would come again.
    std::thread::sleep(Duration::from_millis(300));
    let start = clock::monotonic();
    bridge.cut();
    // It may be back before the test has looked.
    assert!(eventually(|| log.has("link is down")));
    assert!(eventually(|| ctx.link() == LinkState::Up));
    // Noticed at once and not by silence, and connected again.
    let took = clock::monotonic() - start;
    assert!(took < 30_000_000_000, "{took} ns");
    running.stop();
    all_come_back(&ctx, 50);
}

#[test]
fn a_serial_line_carries_everything_even_with_damaged_bytes() {
    let _dog = watchdog("serial", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let (bridge, path) = Bridge::pty(agent.address);
    let ctx = over_serial(&path);
    let start = std::time::Instant::now();
    all_come_back(&ctx, 50);
    println!("clean: {:?}", start.elapsed());
    bridge.damage(4_000);
    all_come_back(&ctx, 50);
}

#[test]
fn the_agents_own_tcp_port_is_as_good() {
    let _dog = watchdog("agent's tcp", LIMIT);
    let agent = TestAgent::with(&AgentConfig {
        addr: "127.0.0.1:0".parse().unwrap(),
        tcp: Some("127.0.0.1:0".parse().unwrap()),
        ..AgentConfig::default()
    });
    let ctx = over_tcp(agent.tcp.unwrap());
    all_come_back(&ctx, 200);
}

#[test]
fn the_agents_own_serial_port_at_its_real_speed() {
    let _dog = watchdog("agent's line", LIMIT);
    let (bridge, here, there) = Bridge::line(115_200);
    let _agent = TestAgent::with(&AgentConfig {
        addr: "127.0.0.1:0".parse().unwrap(),
        serial: vec![SerialConfig::new(there)],
        ..AgentConfig::default()
    });
    for every in [0, 4_001, 1_009] {
        bridge.damage(every);
        let ctx = over_serial(&here);
        let start = std::time::Instant::now();
        all_come_back(&ctx, 20);
        println!("one byte of {every} damaged: {:?}", start.elapsed());
    }
}

#[test]
fn no_line_and_no_agent_are_clear_errors() {
    let error = Context::xrce_serial("/dev/null", 115_200).unwrap_err();
    assert!(error.to_string().contains("/dev/null"), "{error}");
    let nobody = "127.0.0.1:1";
    let error = Context::xrce_tcp(nobody).unwrap_err();
    let message = format!("no XRCE agent answered at {nobody} within 1.5 s");
    assert_eq!(error.to_string(), message);
}

/// A transport of the user's own: UDP, and it counts.
#[derive(Debug)]
struct Mine(UdpTransport, Arc<Mutex<u64>>);

impl Transport for Mine {
    fn send(&self, _now: u64, message: &[u8]) -> io::Result<Sent> {
        *self.1.lock().unwrap() += 1;
        self.0.send(message)
    }

    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received> {
        let mut buf = [0; 600];
        Ok(match self.0.recv(&mut buf)? {
            Some(len) => {
                deliver(&buf[..len]);
                Received::Something
            }
            None => Received::Nothing,
        })
    }

    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<BorrowedFd<'_>>)) {
        wait(Some(self.0.as_fd()));
    }
}

#[test]
fn a_transport_of_ones_own_is_as_good() {
    let _dog = watchdog("custom", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let sent = Arc::new(Mutex::new(0));
    let mine = Mine(
        UdpTransport::connect(agent.address).unwrap(),
        Arc::clone(&sent),
    );
    let ctx = Context::new(Xrce::over("mine", mine, patient(XrceConfig::default())).unwrap());
    all_come_back(&ctx, 100);
    assert!(*sent.lock().unwrap() > 100);
}

#[test]
fn an_agent_is_pinged_before_there_is_a_session() {
    let _dog = watchdog("ping", LIMIT);
    for place in ["127.0.0.1:0", "[::1]:0"] {
        let agent = TestAgent::start(place);
        let address = agent.address.to_string();
        let second = Duration::from_secs(1);
        let answer = Xrce::ping_udp(&address, second, 30).unwrap();
        assert!(answer.is_some_and(|time| time <= second), "{answer:?}");
        assert!(agent.snapshot().clients.is_empty(), "nothing is remembered");
    }
    // A port without a program, and one whose program answers something else.
    let other = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let silent = other.local_addr().unwrap();
    let chatter = std::thread::spawn(move || {
        let mut room = [0; 64];
        for _ in 0..3 {
            let (len, from) = other.recv_from(&mut room).unwrap();
            other.send_to(&room[..len], from).unwrap(); // its own question, and no answer
        }
    });
    let began = std::time::Instant::now();
    let patience = Duration::from_millis(20);
    assert_eq!(
        Xrce::ping_udp(&silent.to_string(), patience, 3).unwrap(),
        None
    );
    assert!(began.elapsed() >= 3 * patience);
    chatter.join().unwrap();
    assert_eq!(
        Xrce::ping_udp(&silent.to_string(), patience, 2).unwrap(),
        None
    );
    assert_eq!(
        Xrce::ping_udp(&silent.to_string(), patience, 0).unwrap(),
        None
    );
    let error = Xrce::ping_udp("nowhere", patience, 1)
        .unwrap_err()
        .to_string();
    assert!(error.contains("nowhere"), "{error}");
}
