//! The agent is a process that is killed (SIGKILL) during reliable traffic, again and again, and
//! another one takes its place.
//!
//! Samples that the client knew to be acknowledged came once; others are sent again, and may come
//! twice. Nothing is missing.

use crate::common::eventually;
use replenish::Qos;
use replenish::middleware::xrce::Xrce;
use replenish::middleware::{
    EndpointSpec, Interest, LinkState, Middleware, PublishError, Room, WriterId,
};
use replenish::qos::IngressLimit;
use replenish_agent::{Agent, AgentConfig, StopHandle};
use replenish_os::clock;
use replenish_testkit::steal;
use replenish_testkit::watchdog::watchdog;
use replenish_xrce::client;
use replenish_xrce::wire::RequestId;
use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Says to this very binary, when it is started once more, where to be an agent.
const AGENT: &str = "REPLENISH_TEST_AGENT";

/// An agent in a process of its own.
struct AgentProcess(Child);

impl AgentProcess {
    fn start(address: SocketAddr) -> Self {
        let child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "xrce_restart::be_an_agent",
                "--ignored",
                "--nocapture",
            ])
            .env(AGENT, address.to_string())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }

    /// Waits until it answers.
    fn is_there(address: SocketAddr) -> bool {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let timeout = Some(Duration::from_millis(20));
        socket.set_read_timeout(timeout).unwrap();
        let mut buf = [0; 64];
        let request = RequestId(11);
        let question = client::ping(request, None, &mut buf).unwrap();
        socket.send_to(question, address).unwrap();
        let mut answer = [0; 64];
        let len = socket.recv(&mut answer).unwrap_or(0);
        client::pong(request, &answer[..len]).is_some()
    }
}

impl Drop for AgentProcess {
    fn drop(&mut self) {
        self.0.kill().ok(); // SIGKILL
        self.0.wait().ok();
    }
}

/// Not a test: what the processes do that the test starts.
#[test]
#[ignore = "the agent's process"]
fn be_an_agent() {
    let Ok(address) = std::env::var(AGENT) else {
        return;
    };
    let config = AgentConfig {
        addr: address.parse().unwrap(),
        ..AgentConfig::default()
    };
    let mut agent = Agent::bind(&config).unwrap();
    agent.run(&StopHandle::new()).unwrap();
}

fn spec(qos: Qos) -> EndpointSpec<'static> {
    EndpointSpec {
        node: "/restart",
        topic: "/steady",
        type_name: "std_msgs/msg/UInt8MultiArray",
        dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
        type_hash: None,
        qos,
        max_size: 2000,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

type Heard = Arc<Mutex<Vec<u32>>>;

/// The longest delay of a thread that should run every 10 ms. On an overloaded machine a restart is
/// not noticed any sooner than that.
#[derive(Default)]
struct Stalls(Mutex<Duration>);

impl Stalls {
    fn note(&self, turn: Duration) {
        let mut worst = self.0.lock().unwrap();
        *worst = (*worst).max(turn.saturating_sub(Duration::from_millis(20)));
    }

    fn take(&self) -> Duration {
        std::mem::take(&mut self.0.lock().unwrap())
    }
}

/// Runs the session as a dispatcher does; notes the numbers it gets.
fn dispatch(
    middleware: &Arc<Xrce>,
    mut interest: Interest,
    stop: &Arc<AtomicBool>,
    stalls: &Arc<Stalls>,
) -> (JoinHandle<()>, Heard) {
    let heard = Heard::default();
    let (middleware, stop, sink) = (Arc::clone(middleware), Arc::clone(stop), Arc::clone(&heard));
    let stalls = Arc::clone(stalls);
    let thread = thread::spawn(move || {
        let mut turn = Instant::now();
        while !stop.load(Ordering::SeqCst) {
            let deadline = clock::monotonic() + 10_000_000;
            middleware.wait(&interest, Some(deadline)).unwrap();
            stalls.note(turn.elapsed());
            turn = Instant::now();
            let mut heard = sink.lock().unwrap();
            middleware
                .take(&mut interest, &mut |_, _, bytes| {
                    let (number, rest) = bytes.split_first_chunk().unwrap();
                    assert!(
                        rest.iter().all(|byte| *byte == number[0]),
                        "a damaged sample"
                    );
                    heard.push(u32::from_le_bytes(*number));
                    Room::Left
                })
                .unwrap();
        }
    });
    (thread, heard)
}

fn sample(number: u32) -> Vec<u8> {
    let bytes = number.to_le_bytes();
    let len = if number.is_multiple_of(10) { 2000 } else { 100 };
    let mut sample = vec![bytes[0]; len];
    sample[..4].copy_from_slice(&bytes);
    sample
}

/// Publishes `number`, waiting while there is no room; false while there is no agent.
fn publish(middleware: &Xrce, writer: WriterId, number: u32) -> bool {
    loop {
        match middleware.publish(writer, &sample(number)) {
            Ok(()) => return true,
            Err(PublishError::Full) => thread::sleep(Duration::from_micros(200)),
            Err(PublishError::LinkDown) => return false,
            Err(error) => panic!("{error}"),
        }
    }
}

/// The limits in wall time, of the client and of the test, are those of a machine that keeps up.
#[test]
fn what_was_acknowledged_came_once_and_traffic_resumes_within_two_seconds() {
    steal::unstalled("restart", &restarts);
}

fn restarts() {
    const ROUNDS: u32 = 6;
    let _dog = watchdog("restart", Duration::from_secs(120));
    let address = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let mut agent = Some(AgentProcess::start(address));
    assert!(eventually(|| AgentProcess::is_there(address)));
    let talker = Arc::new(Xrce::udp(&address.to_string()).unwrap());
    let listener = Arc::new(Xrce::udp(&address.to_string()).unwrap());
    let qos = Qos::reliable().keep_all(256);
    let writer = talker.create_writer(&spec(qos)).unwrap();
    let reader = listener.create_reader(&spec(qos)).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let stalls = Arc::new(Stalls::default());
    let mut interest = Interest::empty();
    interest.insert(reader);
    let (talking, _) = dispatch(&talker, Interest::empty(), &stop, &stalls);
    let (listening, heard) = dispatch(&listener, interest, &stop, &stalls);

    let seed = std::env::var("REPLENISH_TEST_SEED").map_or(7, |seed| seed.parse().unwrap());
    let mut random = seed;
    let mut draw = |below: u64| {
        random = u64::wrapping_mul(random, 6_364_136_223_846_793_005).wrapping_add(1);
        (random >> 33) % below
    };
    let mut next = 0_u32;
    // Numbers that the talker knew to be acknowledged before a kill.
    let mut certain = Vec::new();
    let (mut slowest_notice, mut slowest_return) = (Duration::ZERO, Duration::ZERO);
    for round in 0..ROUNDS {
        let first = next;
        let mut acknowledged = first;
        for _ in 0..100 + draw(300) {
            assert!(publish(&talker, writer, next), "round {round}: no agent");
            next += 1;
            thread::sleep(Duration::from_micros(draw(500)));
            if talker.stats().unacknowledged == 0 {
                acknowledged = next;
            }
        }
        for _ in 0..draw(40) {
            publish(&talker, writer, next);
            next += 1;
            if talker.stats().unacknowledged == 0 {
                acknowledged = next;
            }
        }
        assert!(
            acknowledged > first,
            "round {round}: nothing was acknowledged"
        );
        certain.extend(first..acknowledged);
        drop(agent.take());
        stalls.take();
        let killed = Instant::now();
        // In every other round the system does not report that the agent is gone.
        let silent = (round % 2 == 0).then(|| UdpSocket::bind(address).unwrap());
        for _ in 0..5 {
            publish(&talker, writer, next); // to nobody
            next += 1;
        }
        assert!(eventually(|| talker.link() != LinkState::Up));
        let noticed = killed.elapsed();
        assert!(
            noticed < Duration::from_secs(1) + stalls.take(),
            "round {round}: noticed after {noticed:?}"
        );
        slowest_notice = slowest_notice.max(noticed);
        thread::sleep(Duration::from_millis(draw(600)));
        drop(silent);
        agent = Some(AgentProcess::start(address));
        assert!(eventually(|| AgentProcess::is_there(address)));
        let restarted = Instant::now();
        let before = heard.lock().unwrap().len();
        let both = || talker.link() == LinkState::Up && listener.link() == LinkState::Up;
        assert!(eventually(both));
        assert!(publish(&talker, writer, next));
        next += 1;
        assert!(eventually(|| heard.lock().unwrap().len() > before));
        let resumed = restarted.elapsed();
        assert!(
            resumed < Duration::from_secs(2),
            "round {round}: resumed after {resumed:?}"
        );
        slowest_return = slowest_return.max(resumed);
    }
    assert!(eventually(
        || heard.lock().unwrap().last() == Some(&(next - 1))
    ));
    stop.store(true, Ordering::SeqCst);
    talking.join().unwrap();
    listening.join().unwrap();

    let mut times: BTreeMap<u32, u64> = BTreeMap::new();
    for number in heard.lock().unwrap().iter() {
        *times.entry(*number).or_default() += 1;
    }
    let stats = talker.stats().link;
    let again: u64 = times.values().map(|times| times - 1).sum();
    println!(
        "{next} published, {} acknowledged before a kill, {again} came twice; lost agent noticed \
         within {slowest_notice:?}, back within {slowest_return:?}; {stats:?}",
        certain.len()
    );
    assert_eq!((stats.losses, stats.lost), (ROUNDS.into(), 0));
    assert!(times.keys().copied().eq(0..next), "some are missing");
    for number in &certain {
        assert_eq!(times[number], 1, "{number} of {certain:?}");
    }
    assert!(
        again <= stats.carried,
        "{again} came twice, {} were sent again",
        stats.carried
    );
    assert!(stats.carried >= u64::from(ROUNDS) * 5, "{stats:?}");
}
