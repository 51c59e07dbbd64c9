//! The XRCE adapter against a real agent on loopback: samples both ways, limits, loss and return of
//! the agent, and that publishers never wait for the dispatcher.

use replenish::middleware::xrce::{ConnectError, Xrce, XrceConfig};
use replenish::middleware::{
    EndpointSpec, Interest, LinkState, Middleware, MiddlewareError, PublishError, ReaderId, Room,
    WriterId,
};
use replenish::qos::{IngressLimit, Qos};
use replenish_agent::{Agent, AgentConfig, Limits, RunningAgent};
use replenish_os::clock;
use replenish_testkit::steal;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const MILLI: u64 = 1_000_000;

/// The longest time that any step may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

fn agent_at(addr: &str) -> RunningAgent {
    let addr = addr.parse().unwrap();
    Agent::bind(&AgentConfig {
        addr,
        ..AgentConfig::default()
    })
    .unwrap()
    .spawn()
    .unwrap()
}

fn connect(agent: SocketAddr) -> Xrce {
    Xrce::udp(&agent.to_string()).unwrap()
}

fn spec(topic: &'static str, qos: Qos, max_size: usize) -> EndpointSpec<'static> {
    EndpointSpec {
        node: "/tester",
        topic,
        type_name: "std_msgs/msg/UInt8MultiArray",
        dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
        type_hash: None,
        qos,
        max_size,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

fn interest(readers: &[ReaderId]) -> Interest {
    let mut set = Interest::empty();
    readers.iter().for_each(|reader| set.insert(*reader));
    set
}

/// Waits and takes like a dispatcher until `n` samples have come or a minute has passed. `others`
/// get their turn meanwhile.
fn collect(
    middleware: &Xrce,
    readers: &[ReaderId],
    n: usize,
    others: &[&Xrce],
) -> Vec<(ReaderId, Vec<u8>)> {
    let (mut set, end) = (interest(readers), Instant::now() + PATIENCE);
    let mut samples = Vec::new();
    while samples.len() < n && Instant::now() < end {
        for other in others {
            other
                .take(&mut Interest::empty(), &mut |_, _, _| Room::Left)
                .unwrap();
        }
        middleware
            .wait(&set, Some(clock::monotonic() + MILLI))
            .unwrap();
        middleware
            .take(&mut set, &mut |reader, _, bytes| {
                samples.push((reader, bytes.to_vec()));
                Room::Left
            })
            .unwrap();
    }
    samples
}

/// Whether `sample` is what `reader` gets next, and all it gets.
fn gets(middleware: &Xrce, reader: ReaderId, sample: &[u8], other: &Xrce) -> bool {
    collect(middleware, &[reader], 1, &[other]) == [(reader, sample.to_vec())]
}

/// Runs the session like a dispatcher without interest until `done` or a minute has passed.
fn spin_until(middleware: &Xrce, done: impl Fn() -> bool) -> bool {
    let end = Instant::now() + PATIENCE;
    let mut nobody = Interest::empty();
    while !done() {
        if Instant::now() > end {
            return false;
        }
        middleware
            .wait(&nobody, Some(clock::monotonic() + 10 * MILLI))
            .unwrap();
        middleware
            .take(&mut nobody, &mut |_, _, _| Room::Left)
            .unwrap();
    }
    true
}

/// Publishes, giving the dispatcher's part its turn while the output queue is full.
fn publish(middleware: &Xrce, writer: WriterId, payload: &[u8]) {
    let sent = || match middleware.publish(writer, payload) {
        Ok(()) => true,
        Err(PublishError::Full) => false,
        Err(error) => panic!("{error}"),
    };
    assert!(spin_until(middleware, sent), "the output queue stays full");
}

#[test]
fn samples_go_both_ways_on_both_streams() {
    let agent = agent_at("127.0.0.1:0");
    let (ping, pong) = (connect(agent.local_addr()), connect(agent.local_addr()));
    for (qos, sizes) in [
        (Qos::best_effort(), &[0, 4, 37, 500][..]),
        (
            Qos::reliable().keep_last(64),
            &[0, 4, 500, 501, 4096, 16_000],
        ),
    ] {
        let largest = *sizes.last().unwrap();
        let there = spec("/there", qos, largest);
        let back = spec("/back", qos, largest);
        let (writer, reader) = (
            ping.create_writer(&there).unwrap(),
            ping.create_reader(&back).unwrap(),
        );
        let (echo_writer, echo_reader) = (
            pong.create_writer(&back).unwrap(),
            pong.create_reader(&there).unwrap(),
        );
        for (i, &size) in sizes.iter().enumerate() {
            let sample: Vec<u8> = (0..size).map(|at| (at * 7 + i) as u8).collect();
            publish(&ping, writer, &sample);
            assert!(
                gets(&pong, echo_reader, &sample, &ping),
                "{size} bytes there, {qos:?}"
            );
            publish(&pong, echo_writer, &sample);
            assert!(
                gets(&ping, reader, &sample, &pong),
                "{size} bytes back, {qos:?}"
            );
        }
    }
    assert_eq!((ping.link(), pong.link()), (LinkState::Up, LinkState::Up));
}

#[test]
fn data_of_readers_without_room_waits_and_does_not_end_the_wait() {
    let agent = agent_at("127.0.0.1:0");
    let middleware = connect(agent.local_addr());
    let (all, last) = (Qos::reliable().keep_all(8), Qos::best_effort().keep_last(2));
    let all_writer = middleware.create_writer(&spec("/all", all, 8)).unwrap();
    let last_writer = middleware.create_writer(&spec("/last", last, 8)).unwrap();
    let all_reader = middleware.create_reader(&spec("/all", all, 8)).unwrap();
    let last_reader = middleware.create_reader(&spec("/last", last, 8)).unwrap();
    for i in 0_u8..6 {
        publish(&middleware, all_writer, &[i]);
        publish(&middleware, last_writer, &[i]);
    }
    // The interest set is empty: the session receives everything and keeps it.
    assert!(spin_until(&middleware, || middleware.lost(last_reader) == 4));
    let start = Instant::now();
    let mut waits = 0;
    while start.elapsed() < Duration::from_millis(60) {
        let deadline = clock::monotonic() + 20 * MILLI;
        middleware.wait(&Interest::empty(), Some(deadline)).unwrap();
        middleware
            .take(&mut Interest::empty(), &mut |_, _, _| panic!("no interest"))
            .unwrap();
        waits += 1;
    }
    // Twenty would be spinning; a heartbeat or ping more or less is not.
    assert!(waits < 20, "{waits} waits in 60 ms");
    // Interested now: no wait at all, in order, and not more than there is room for.
    let set = interest(&[all_reader, last_reader]);
    let start = Instant::now();
    middleware
        .wait(&set, Some(clock::monotonic() + 120_000 * MILLI))
        .unwrap();
    assert!(start.elapsed() < PATIENCE, "did not wait for the deadline");
    let mut taken = Vec::new();
    let room = |limit: usize, taken: &mut Vec<(ReaderId, u8)>| {
        let (mut given, mut set) = (0, set);
        middleware
            .take(&mut set, &mut |reader, _, bytes| {
                taken.push((reader, bytes[0]));
                given += 1;
                if given < limit {
                    Room::Left
                } else {
                    Room::Full
                }
            })
            .unwrap()
    };
    assert_eq!(room(1, &mut taken), 2, "one for each reader, then full");
    assert_eq!(taken, [(all_reader, 0), (last_reader, 4)]);
    taken.clear();
    assert_eq!(room(usize::MAX, &mut taken), 6);
    let of = |reader| -> Vec<u8> {
        taken
            .iter()
            .filter(|(r, _)| *r == reader)
            .map(|(_, byte)| *byte)
            .collect()
    };
    assert_eq!(
        (of(all_reader), of(last_reader)),
        (vec![1, 2, 3, 4, 5], vec![5])
    );
    assert_eq!(middleware.lost(all_reader), 0);
}

#[test]
fn a_publisher_never_waits_for_a_dispatcher_that_waits() {
    let agent = agent_at("127.0.0.1:0");
    let middleware = Arc::new(connect(agent.local_addr()));
    let writers: Vec<WriterId> = (0..8)
        .map(|i| {
            let qos = if i % 2 == 0 {
                Qos::best_effort()
            } else {
                Qos::reliable()
            };
            middleware.create_writer(&spec("/flood", qos, 64)).unwrap()
        })
        .collect();
    let stop = Arc::new(AtomicBool::new(false));
    // A dispatcher whose waits are as long as they can be.
    let dispatcher = thread::spawn({
        let (middleware, stop) = (Arc::clone(&middleware), Arc::clone(&stop));
        move || {
            while !stop.load(Ordering::SeqCst) {
                middleware.wait(&Interest::empty(), None).unwrap();
                middleware
                    .take(&mut Interest::empty(), &mut |_, _, _| Room::Left)
                    .unwrap();
            }
        }
    });
    thread::sleep(Duration::from_millis(50));
    let start = Instant::now();
    let threads: Vec<_> = writers
        .into_iter()
        .map(|writer| {
            let middleware = Arc::clone(&middleware);
            thread::spawn(move || {
                let mut sent = 0;
                while sent < 200 {
                    match middleware.publish(writer, &[7; 32]) {
                        Ok(()) => sent += 1,
                        Err(PublishError::Full) => thread::yield_now(),
                        Err(error) => panic!("{error}"),
                    }
                }
            })
        })
        .collect();
    threads
        .into_iter()
        .for_each(|thread| thread.join().unwrap());
    // 1600 publications that each waited for even a millisecond of the dispatcher's wait would
    // have taken 200 ms per thread; for a ping period, 40 s.
    assert!(
        start.elapsed() < Duration::from_secs(10),
        "{:?}",
        start.elapsed()
    );
    stop.store(true, Ordering::SeqCst);
    middleware.wake();
    dispatcher.join().unwrap();
}

#[test]
fn wake_ends_a_wait_before_and_while_it_waits() {
    let agent = agent_at("127.0.0.1:0");
    let middleware = Arc::new(connect(agent.local_addr()));
    let start = Instant::now();
    middleware.wake();
    middleware.wait(&Interest::empty(), None).unwrap();
    let waker = Arc::clone(&middleware);
    let thread = thread::spawn(move || {
        thread::sleep(Duration::from_millis(20));
        waker.wake();
    });
    while start.elapsed() < Duration::from_millis(15) {
        middleware.wait(&Interest::empty(), None).unwrap();
        middleware
            .take(&mut Interest::empty(), &mut |_, _, _| Room::Left)
            .unwrap();
    }
    thread.join().unwrap();
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn no_agent_is_a_clear_error_within_two_seconds() {
    steal::unstalled("no agent", &no_agent);
}

fn no_agent() {
    // A port without a program, and one whose program does not answer.
    let mute = UdpSocket::bind("127.0.0.1:0").unwrap();
    for address in ["127.0.0.1:1".into(), mute.local_addr().unwrap().to_string()] {
        let start = Instant::now();
        let error = Xrce::udp(&address).unwrap_err();
        assert!(
            start.elapsed() < Duration::from_secs(2),
            "{:?}",
            start.elapsed()
        );
        let message = error.to_string();
        assert_eq!(
            message,
            format!("no XRCE agent answered at {address} within 1.5 s")
        );
    }
    let error = Xrce::udp("127.0.0.1:notaport").unwrap_err();
    assert!(matches!(error, ConnectError::Address { .. }), "{error}");
    for config in [
        XrceConfig {
            mtu: 63,
            ..XrceConfig::default()
        },
        XrceConfig {
            window: 0,
            ..XrceConfig::default()
        },
        XrceConfig {
            window: 65,
            ..XrceConfig::default()
        },
        XrceConfig {
            max_sample: 0,
            ..XrceConfig::default()
        },
        XrceConfig {
            key: Some([0; 4]),
            ..XrceConfig::default()
        },
    ] {
        let error = Xrce::udp_with("127.0.0.1:8888", config).unwrap_err();
        assert!(matches!(error, ConnectError::Setting { .. }), "{error}");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_size_and_limit() {
    let agent = agent_at("127.0.0.1:0");
    let middleware = connect(agent.local_addr());
    let too_large = |size, limit| MiddlewareError::TooLarge {
        size,
        limit,
        setting: "of best-effort ones it is XrceConfig::mtu - 12, with an mtu of 64..=65507",
    };
    let big = spec("/big", Qos::best_effort(), 4096);
    assert_eq!(middleware.create_writer(&big), Err(too_large(4096, 500)));
    assert_eq!(middleware.create_reader(&big), Err(too_large(4096, 500)));
    let small = middleware
        .create_writer(&spec("/small", Qos::best_effort(), 10))
        .unwrap();
    assert_eq!(
        middleware.publish(small, &[0; 11]),
        Err(PublishError::TooLarge {
            size: 11,
            limit: 10
        })
    );
    assert_eq!(
        middleware.publish(WriterId(99), &[0]),
        Err(PublishError::UnknownWriter)
    );

    let config = XrceConfig {
        mtu: 8192,
        ..XrceConfig::default()
    };
    let wide = Xrce::udp_with(&agent.local_addr().to_string(), config).unwrap();
    let (writer, reader) = (
        wide.create_writer(&big).unwrap(),
        wide.create_reader(&big).unwrap(),
    );
    publish(&wide, writer, &[9; 4096]);
    assert!(collect(&wide, &[reader], 1, &[]) == [(reader, vec![9; 4096])]);
}

/// A megabyte and a half there and back, in the pieces of micro-ROS and in long ones. An agent that
/// takes no such samples loses them alone.
#[test]
fn long_samples_go_through_an_agent_that_takes_them() {
    const LONG: usize = 1_500_001;
    let bytes =
        |number: usize| -> Vec<u8> { (0..LONG).map(|at| (at / 251 + at + number) as u8).collect() };
    let limits = Limits {
        sample: 2 << 20,
        client_bytes: 64 << 20,
        ..Limits::DEFAULT
    };
    let config = AgentConfig {
        addr: "127.0.0.1:0".parse().unwrap(),
        limits,
        ..AgentConfig::default()
    };
    let agent = Agent::bind(&config).unwrap().spawn().unwrap();
    let ends = |address: SocketAddr, mtu| {
        let config = XrceConfig {
            mtu,
            max_sample: LONG,
            ..XrceConfig::default()
        };
        let middleware = Xrce::udp_with(&address.to_string(), config).unwrap();
        let spec = spec("/long", Qos::reliable().keep_all(2), LONG);
        let writer = middleware.create_writer(&spec).unwrap();
        let reader = middleware.create_reader(&spec).unwrap();
        (middleware, writer, reader)
    };
    for mtu in [512, 8192] {
        let (middleware, writer, reader) = ends(agent.local_addr(), mtu);
        for number in 0..3 {
            let sample = bytes(number);
            publish(&middleware, writer, &sample);
            assert!(collect(&middleware, &[reader], 1, &[]) == [(reader, sample)]);
        }
    }
    drop(agent);
    let agent = agent_at("127.0.0.1:0");
    let (middleware, writer, reader) = ends(agent.local_addr(), 8192);
    publish(&middleware, writer, &bytes(0));
    publish(&middleware, writer, b"short");
    assert!(collect(&middleware, &[reader], 1, &[]) == [(reader, b"short".to_vec())]);
    let inspector = agent.inspector();
    let stats = inspector.snapshot(PATIENCE).unwrap().stats;
    assert_eq!((stats.samples_refused, stats.malformed), (1, 0));
    // Its window holds more than an agent takes without being asked.
    let wide = XrceConfig {
        mtu: 8192,
        ..XrceConfig::default()
    };
    let wide = Xrce::udp_with(&agent.local_addr().to_string(), wide).unwrap();
    let (qos, most) = (Qos::reliable(), 65_528);
    assert!(wide.create_writer(&spec("/most", qos, most)).is_ok());
    let refused = wide.create_writer(&spec("/most", qos, most + 1));
    assert!(matches!(refused, Err(MiddlewareError::TooLarge { limit, .. }) if limit == most));
}

#[test]
fn a_full_window_is_an_error_and_not_a_wait() {
    let agent = agent_at("127.0.0.1:0");
    let middleware = connect(agent.local_addr());
    let writer = middleware
        .create_writer(&spec("/full", Qos::reliable(), 400))
        .unwrap();
    // The session does not run, so that no acknowledgement comes and the window fills.
    let start = Instant::now();
    let full = (0..100)
        .map(|_| middleware.publish(writer, &[1; 400]))
        .find(Result::is_err);
    assert_eq!(full, Some(Err(PublishError::Full)));
    assert!(start.elapsed() < Duration::from_secs(1));
    assert!(spin_until(&middleware, || middleware
        .publish(writer, &[1; 400])
        .is_ok()));
}

#[test]
fn an_agent_that_goes_away_is_reported_and_everything_returns_with_it() {
    steal::unstalled("an agent goes away", &goes_away);
}

/// The limits in wall time, of the client and of the test, are those of a machine that keeps up.
fn goes_away() {
    let agent = agent_at("127.0.0.1:0");
    let address = agent.local_addr();
    let middleware = connect(address);
    let reliable = Qos::reliable();
    let writer = middleware
        .create_writer(&spec("/steady", reliable, 8))
        .unwrap();
    let reader = middleware
        .create_reader(&spec("/steady", reliable, 8))
        .unwrap();
    publish(&middleware, writer, b"before");
    assert_eq!(collect(&middleware, &[reader], 1, &[]).len(), 1);

    agent.stop().unwrap();
    let start = Instant::now();
    assert!(spin_until(&middleware, || middleware.link() != LinkState::Up));
    assert!(
        start.elapsed() < Duration::from_secs(2),
        "noticed after {:?}",
        start.elapsed()
    );
    assert_eq!(
        middleware.publish(writer, b"lost"),
        Err(PublishError::LinkDown)
    );
    assert_eq!(
        middleware.create_reader(&spec("/later", reliable, 8)),
        Err(MiddlewareError::LinkDown)
    );

    let agent = agent_at(&address.to_string());
    let start = Instant::now();
    assert!(spin_until(&middleware, || middleware.link() == LinkState::Up));
    assert!(
        start.elapsed() < Duration::from_secs(2),
        "back after {:?}",
        start.elapsed()
    );
    publish(&middleware, writer, b"after");
    assert_eq!(
        collect(&middleware, &[reader], 1, &[]),
        [(reader, b"after".to_vec())]
    );
    let stats = middleware.stats();
    assert_eq!((stats.link.losses, stats.link.sessions), (1, 2));
    drop(agent);
}

#[test]
fn a_session_that_is_dropped_is_gone_at_the_agent() {
    let agent = agent_at("127.0.0.1:0");
    let key = XrceConfig {
        key: Some([1, 2, 3, 4]),
        ..XrceConfig::default()
    };
    for _ in 0..3 {
        let middleware = Xrce::udp_with(&agent.local_addr().to_string(), key).unwrap();
        let reader = middleware
            .create_reader(&spec("/again", Qos::reliable(), 8))
            .unwrap();
        assert_eq!(reader, ReaderId(0));
    }
}
