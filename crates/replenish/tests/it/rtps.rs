//! ROS 2 without an agent, among our own: two participants on loopback, and two ends in one.
//! Genuine ROS 2 is in `tests/ros2`.

use crate::common::{Echo, Gate, eventually, executor};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::middleware::{EndpointSpec, Interest, Middleware, MiddlewareError, ReaderId, Room};
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{Context, Error, Executor, IngressLimit, Node, PublishError, Qos, Topic};
use replenish_os::clock;
use replenish_rtps::participant::{self as rtps, Limits};
use replenish_rtps::udp::{UdpConfig, UdpParticipant};
use replenish_rtps::wire::{AckNack, MessageWriter, SequenceSet};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A domain for each test: tests run side by side.
pub(crate) fn config() -> RtpsConfig {
    RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    }
}

pub(crate) fn open(config: &RtpsConfig) -> Context {
    Context::new(Rtps::open(config).unwrap())
}

/// In a namespace of this process: others may be in the same domain.
fn node(ctx: &Context, name: &str) -> Node {
    ctx.node(&format!("p{}/{name}", std::process::id()))
        .unwrap()
}

fn topic(name: &str) -> String {
    format!("/p{}/{name}", std::process::id())
}

/// 500 numbers there and back, reliable, through two executors; the last as soon as the first.
#[test]
fn two_participants_hear_each_other() {
    let _dog = watchdog("two participants", Duration::from_secs(120));
    let config = config();
    let (ping, pong) = (open(&config), open(&config));
    let qos = Qos::reliable().keep_all(16);
    // A callback does not wait for room.
    let roomy = Qos::reliable().keep_last(1000);
    let out = node(&pong, "pong");
    let back = out.publisher::<Int32>("back", roomy).unwrap();
    let (mut exec, _) = executor(&pong);
    exec.worker("pong")
        .subscribe(&out, "there", qos, move |m: &Int32, _| back.publish(m))
        .unwrap();
    let pong = exec.start().unwrap();
    let node = node(&ping, "ping");
    let there = node
        .publisher::<Int32>("there", qos.transient_local())
        .unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    let (mut exec, _) = executor(&ping);
    exec.worker("ping")
        .subscribe(&node, "back", qos, move |m: &Int32, _| {
            sink.lock().unwrap().push(m.data);
        })
        .unwrap();
    let ping = exec.start().unwrap();
    // Volatile: a sample from before they know each other is delivered to none.
    assert!(eventually(|| {
        there.publish(&Int32 { data: -1 }).unwrap();
        std::thread::sleep(Duration::from_millis(20));
        !heard.lock().unwrap().is_empty()
    }));
    for data in 0..500 {
        assert!(eventually(
            || there.publish(&Int32 { data }) != Err(PublishError::Full)
        ));
    }
    assert!(eventually(|| heard.lock().unwrap().last() == Some(&499)));
    let heard = heard.lock().unwrap().clone();
    let numbers: Vec<i32> = heard.into_iter().skip_while(|data| *data == -1).collect();
    assert_eq!(numbers, (0..500).collect::<Vec<_>>());
    drop((ping.stop(), pong.stop()));
}

/// Longer than a datagram.
#[test]
fn long_samples_go_in_fragments() {
    let _dog = watchdog("long samples", Duration::from_secs(60));
    let node = node(&open(&config()), "n");
    let out = node
        .publisher::<UInt8MultiArray>("bytes", Qos::reliable())
        .unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    let (mut exec, _) = executor(node.context());
    exec.worker("w")
        .subscribe(
            &node,
            "bytes",
            Qos::reliable(),
            move |m: &UInt8MultiArray, _| {
                assert!(m.data.iter().all(|byte| *byte == 7));
                sink.lock().unwrap().push(m.data.len());
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let mut message = UInt8MultiArray::default();
    for len in [1, 1400, 4096] {
        message.data.clear();
        message.data.resize(len, 7).unwrap();
        out.publish(&message).unwrap();
    }
    assert!(eventually(|| heard.lock().unwrap().len() == 3));
    assert_eq!(*heard.lock().unwrap(), [1, 1400, 4096]);
    drop(running.stop());
}

/// 20 participants with 200 publishers each are found by a participant whose CPU time for discovery
/// is bounded. `--nocapture` shows the time, and the dispatcher's CPU time in the worst 100 ms.
#[test]
fn a_large_network_is_discovered() {
    let _dog = watchdog("a large network", Duration::from_secs(120));
    let config = RtpsConfig {
        endpoints: 5000,
        ..config()
    };
    let observer = Rtps::open(&config).unwrap();
    let local = std::net::Ipv4Addr::LOCALHOST;
    let at: Vec<_> = UdpConfig::unicast(config.domain, local, 1).collect();
    let mut others: Vec<_> = (0..20).map(|_| participant(&config, &at, 200)).collect();
    let (begin, found) = (clock::monotonic(), AtomicBool::new(false));
    let spent = std::thread::scope(|scope| {
        let dispatcher = scope.spawn(|| dispatch(&observer, &found));
        while observer.stats().endpoints < 4000 {
            let until = clock::monotonic() + 10_000_000;
            while clock::monotonic() < until {
                for other in &mut others {
                    other.step(Duration::ZERO).unwrap();
                }
            }
        }
        found.store(true, Ordering::Release);
        observer.wake();
        dispatcher.join().unwrap()
    });
    let mut known = 0;
    observer.graph(&mut |_| known += 1);
    assert_eq!((known, observer.stats().participants), (4000, 20));
    assert_eq!(observer.stats().left_out, 0);
    let within = |from: u64| {
        let window = spent
            .iter()
            .filter(|(at, _)| (from..from + 100_000_000).contains(at));
        window.map(|(_, time)| time).sum::<u64>()
    };
    let worst = spent.iter().map(|(at, _)| within(*at)).max().unwrap();
    println!(
        "{} ms, {} us in 100 ms, {} us in {} rounds, {:?}",
        (clock::monotonic() - begin) / 1_000_000,
        worst / 1000,
        spent.iter().map(|(_, time)| time).sum::<u64>() / 1000,
        spent.len(),
        observer.stats()
    );
}

/// Does a dispatcher's rounds until `end`; when each was over, and the CPU time that it took.
fn dispatch(observer: &Rtps, end: &AtomicBool) -> Vec<(u64, u64)> {
    let mut nobody = Interest::empty();
    let mut spent = Vec::new();
    while !end.load(Ordering::Acquire) {
        let before = clock::thread_cpu();
        observer.wait(&nobody, None).unwrap();
        let taken = observer.take(&mut nobody, &mut |_, _, _| Room::Left);
        assert_eq!(taken.unwrap(), 0);
        spent.push((clock::monotonic(), clock::thread_cpu() - before));
    }
    spent
}

/// A reader that asks for everything again without end takes a tenth of a CPU, and another one gets
/// all that is published meanwhile. `--nocapture` shows the dispatcher's share.
#[test]
fn an_insatiable_reader_has_a_tenth_of_a_cpu() {
    const ASKED: i64 = 100;
    let _dog = watchdog("an insatiable reader", Duration::from_secs(60));
    let config = config();
    let ours = Rtps::open(&config).unwrap();
    let local = std::net::Ipv4Addr::LOCALHOST;
    let at: Vec<_> = UdpConfig::unicast(config.domain, local, 1).collect();
    let name = topic("asked");
    let spec = EndpointSpec {
        node: "/n",
        topic: &name,
        type_name: "std_msgs/msg/Int32",
        dds_type_name: "std_msgs::msg::dds_::Int32_",
        type_hash: None,
        qos: Qos::reliable().keep_last(100),
        max_size: 4,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    };
    let writer = ours.create_writer(&spec).unwrap();
    let rt = format!("rt{name}");
    let [(mut insatiable, theirs), (mut modest, reader)] = [(); 2].map(|()| {
        let mut participant = participant(&config, &at, 0);
        let spec = rtps::EndpointSpec {
            // Room for all that comes while a request is lost in the flood of the other one's.
            qos: replenish_rtps::wire::Qos {
                depth: 100,
                ..replenish_rtps::wire::Qos::ros()
            },
            ..rtps::EndpointSpec::new(&rt, "std_msgs::msg::dds_::Int32_")
        };
        let now = participant.now();
        let reader = participant.participant_mut().create_reader(&spec, now);
        (participant, reader.unwrap())
    });
    let (begin, end) = (AtomicBool::new(false), AtomicBool::new(false));
    let spent = std::thread::scope(|scope| {
        let dispatcher = scope.spawn(|| {
            dispatch(&ours, &begin);
            dispatch(&ours, &end)
        });
        let matched = |of: &UdpParticipant, reader| {
            let reader = of.participant().reader(reader);
            reader.is_some_and(|reader| reader.matched() == 1)
        };
        while ours.matched_readers(writer) != Some(2)
            || !matched(&insatiable, theirs)
            || !matched(&modest, reader)
        {
            insatiable.step(Duration::from_millis(5)).unwrap();
            modest.step(Duration::from_millis(5)).unwrap();
        }
        let mut heard = Vec::new();
        let mut hear = |wait: u64| {
            modest.step(Duration::from_micros(wait)).unwrap();
            while let Some(sample) = modest.participant_mut().take(reader) {
                heard.extend(sample.payload.last());
            }
            heard.clone()
        };
        for _ in 0..ASKED {
            ours.publish(writer, &[0; 4]).unwrap();
            hear(0);
        }
        begin.store(true, Ordering::Release);
        ours.wake();
        // Acknowledgements go to the port above that of discovery.
        let [to] = at[..] else { unreachable!("{at:?}") };
        let to = std::net::SocketAddr::new(to.ip(), to.port() + 1);
        let socket = std::net::UdpSocket::bind((local, 0)).unwrap();
        let peer = insatiable.participant();
        let mut ends = peer.endpoints().filter(|end| end.topic() == rt);
        let guid = ends.next().unwrap().guid;
        let mut state = SequenceSet::empty(1);
        assert!((1..=ASKED).all(|sn| state.insert(sn)));
        let (from, sent) = (clock::monotonic(), ours.stats().sent);
        let mut published = 0;
        for count in 1000.. {
            let mut buf = [0; 200];
            let mut m = MessageWriter::new(&mut buf, peer.prefix()).unwrap();
            m.info_destination(guid.prefix).unwrap();
            m.acknack(&AckNack {
                reader: theirs.entity(),
                writer: guid.entity,
                state,
                count,
                final_flag: false,
            })
            .unwrap();
            socket.send_to(m.message(), to).unwrap();
            if clock::monotonic() > from + u64::from(published) * 20_000_000 {
                published += 1;
                ours.publish(writer, &[published; 4]).unwrap();
                hear(0);
            }
            if published == 50 {
                break;
            }
        }
        let (took, sent) = (clock::monotonic() - from, ours.stats().sent - sent);
        while hear(1000).last() != Some(&published) {}
        end.store(true, Ordering::Release);
        ours.wake();
        let mut heard = hear(0);
        heard.retain(|number| *number > 0);
        assert_eq!(heard, (1..=published).collect::<Vec<_>>());
        assert!(sent > 100, "{sent} datagrams were sent");
        let spent = dispatcher.join().unwrap();
        let meanwhile = spent.iter().filter(|(at, _)| *at < from + took);
        let spent: u64 = meanwhile.map(|(_, time)| time).sum();
        println!(
            "{:.1} % for {sent} datagrams",
            100.0 * spent as f64 / took as f64
        );
        spent as f64 / took as f64
    });
    // With what the rounds themselves take, and the window at either end.
    assert!(spent < 0.2, "{spent} of a CPU");
}

/// A participant of the library alone with so many writers, which knows one other.
fn participant(config: &RtpsConfig, at: &[std::net::SocketAddr], writers: usize) -> UdpParticipant {
    let settings = UdpConfig {
        domain: config.domain,
        multicast: false,
        peers: at,
        limits: Limits {
            own_endpoints: writers + 1,
            participants: 1,
            ..Limits::default()
        },
        ..UdpConfig::default()
    };
    let mut participant = UdpParticipant::open(&settings).unwrap();
    let now = participant.now();
    for number in 0..writers {
        let name = format!("rt/crowd_{number}");
        let spec = rtps::EndpointSpec::new(&name, "std_msgs::msg::dds_::Int32_");
        participant
            .participant_mut()
            .create_writer(&spec, now)
            .unwrap();
    }
    participant
}

/// Two publishers flood one topic and feed another. The reader of the flood is busy: its socket
/// fills, the kernel drops there and counts, and the other topic loses nothing.
#[test]
fn a_flood_is_dropped_in_its_own_socket() {
    let _dog = watchdog("flood", Duration::from_secs(120));
    let config = config();
    let (ours, theirs) = (Rtps::open(&config).unwrap(), Rtps::open(&config).unwrap());
    let spec = |topic| EndpointSpec {
        node: "/n",
        topic,
        type_name: "std_msgs/msg/Int32",
        dds_type_name: "std_msgs::msg::dds_::Int32_",
        type_hash: None,
        qos: Qos::best_effort(),
        max_size: 4,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    };
    let names = ["flood", "control"].map(topic);
    let [flood, control] = [&names[0], &names[1]].map(|t| ours.create_reader(&spec(t)).unwrap());
    let [pours, feeds] = [&names[0], &names[1]].map(|t| theirs.create_writer(&spec(t)).unwrap());
    let mut heard = [0_u32; 2];
    let mut round = |of: &Rtps, readers: &[ReaderId], wait: u64| {
        let mut interest = Interest::empty();
        readers.iter().for_each(|reader| interest.insert(*reader));
        let deadline = replenish_os::clock::monotonic() + wait;
        of.wait(&interest, Some(deadline)).unwrap();
        of.take(&mut interest, &mut |reader, _, _| {
            heard[usize::from(reader == control)] += 1;
            Room::Left
        })
        .unwrap();
        heard
    };
    // Until both topics are heard.
    while round(&ours, &[flood, control], 1_000_000).contains(&0) {
        round(&theirs, &[], 1_000_000);
        theirs.publish(pours, &[0; 4]).unwrap();
        theirs.publish(feeds, &[0; 4]).unwrap();
    }
    while ours.wait(&Interest::empty(), Some(0)).is_ok() && {
        let before = round(&ours, &[flood, control], 20_000_000);
        before != round(&ours, &[flood, control], 20_000_000)
    } {}
    let before = round(&ours, &[control], 0);
    let received = ours.stats().received;
    for _ in 0..200 {
        for _ in 0..100 {
            theirs.publish(pours, &[1; 4]).unwrap();
        }
        theirs.publish(feeds, &[1; 4]).unwrap();
        round(&ours, &[control], 0);
    }
    let mut now = round(&ours, &[control], 10_000_000);
    for _ in 0..100 {
        if now[1] == before[1] + 200 {
            break;
        }
        now = round(&ours, &[control], 10_000_000);
    }
    assert_eq!(now[1] - before[1], 200, "all of the other topic");
    assert_eq!(now[0], before[0], "nothing of the flood was looked at");
    let touched = ours.stats().received - received;
    assert!(
        touched < 1000,
        "{touched} datagrams were received for 200 samples"
    );
    // The kernel says what it has dropped with what it has kept.
    let mut after = now;
    while {
        let next = round(&ours, &[flood], 100_000_000);
        let more = next != after;
        after = next;
        more
    } {}
    theirs.publish(pours, &[1; 4]).unwrap();
    let end = round(&ours, &[flood], 1_000_000_000);
    let (kept, dropped) = (end[0] - before[0] - 1, ours.stats().dropped);
    assert!(dropped > 0, "a socket of the kernel holds 20 000 datagrams");
    assert_eq!(u64::from(kept) + dropped, 20_000, "{kept} kept");
    assert_eq!(ours.lost(flood), dropped);
    assert_eq!(ours.lost(control), 0);
}

/// A publisher that keeps all and a subscription that is busy: nothing is lost.
#[test]
fn keep_all_pushes_back() {
    let _dog = watchdog("keep all", Duration::from_secs(60));
    let node = node(&open(&config()), "n");
    let qos = Qos::reliable().keep_all(4);
    let out = node.publisher::<Int32>("t", qos).unwrap();
    let gate = Gate::closed();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let (sink, inside) = (Arc::clone(&heard), gate.clone());
    let (mut exec, _) = executor(node.context());
    exec.worker("w")
        .subscribe(&node, "t", qos, move |m: &Int32, _| {
            inside.pass();
            sink.lock().unwrap().push(m.data);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let mut sent = 0;
    let mut full = 0;
    while full < 50 {
        match out.publish(&Int32 { data: sent }) {
            Ok(()) => (sent, full) = (sent + 1, 0),
            Err(error) => {
                assert_eq!(error, PublishError::Full);
                full += 1;
                std::thread::sleep(Duration::from_millis(2));
            }
        }
    }
    assert!(sent < 100, "{sent} were taken although nobody reads");
    gate.open();
    assert!(eventually(
        || heard.lock().unwrap().len() == usize::try_from(sent).unwrap()
    ));
    assert_eq!(*heard.lock().unwrap(), (0..sent).collect::<Vec<_>>());
    drop(running.stop());
}

#[test]
fn endpoints_that_do_not_fit_are_reported_to_both() {
    let _dog = watchdog("qos", Duration::from_secs(60));
    let config = config();
    let (node, other) = (node(&open(&config), "n"), node(&open(&config), "m"));
    let _out = node.publisher::<Int32>("t", Qos::best_effort()).unwrap();
    let (mut exec, offered) = executor(node.context());
    exec.worker("idle")
        .timer(Duration::from_secs(60), |_| ())
        .unwrap();
    let first = exec.start().unwrap();
    let (mut exec, requested) = executor(other.context());
    exec.worker("w")
        .subscribe(&other, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let second = exec.start().unwrap();
    let told = "reliability BestEffort is offered, Reliable requested";
    assert!(eventually(|| offered.has(told) && requested.has(told)));
    drop((first.stop(), second.stop()));
}

#[test]
fn a_subscription_that_is_removed_leaves_nothing_behind() {
    let _dog = watchdog("removal", Duration::from_secs(60));
    let spec = EndpointSpec {
        node: "/n",
        topic: &topic("t"),
        type_name: "std_msgs/msg/Int32",
        dds_type_name: "std_msgs::msg::dds_::Int32_",
        type_hash: None,
        qos: Qos::reliable(),
        max_size: 4,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    };
    let ours = Rtps::open(&config()).unwrap();
    for _ in 0..600 {
        let reader = ours.create_reader(&spec).unwrap();
        let writer = ours.create_writer(&spec).unwrap();
        assert_eq!((reader.0, writer.0), (0, 0), "places are used again");
        ours.delete_reader(reader).unwrap();
        ours.delete_writer(writer);
        assert_eq!(
            ours.publish(writer, &[0; 4]),
            Err(PublishError::UnknownWriter)
        );
    }
}

/// A participant that keeps to itself is not found, and finds no other that announces itself to it.
#[test]
fn nobody_is_found_with_discovery_off() {
    let _dog = watchdog("off", Duration::from_secs(60));
    let config = config();
    let off = RtpsConfig {
        range: DiscoveryRange::Off,
        interfaces: vec![[127, 0, 0, 1].into()],
        ..config.clone()
    };
    let all = [off, config.clone(), config].map(|config| Rtps::open(&config).unwrap());
    let round = |of: &Rtps| {
        let deadline = replenish_os::clock::monotonic() + 5_000_000;
        of.wait(&Interest::empty(), Some(deadline)).unwrap();
        let mut nobody = Interest::empty();
        of.take(&mut nobody, &mut |_, _, _| Room::Left).unwrap();
        of.stats().participants
    };
    let [off, one, other] = &all;
    while round(one) == 0 || round(other) == 0 {
        assert_eq!(round(off), 0);
    }
    for _ in 0..20 {
        assert_eq!(round(off), 0);
        round(one);
        round(other);
    }
    // Others of other processes may be in the same domain, but not this one.
    assert_eq!(off.stats().received, 0);
}

/// Without multicast these two would not know of each other: no other participant is in such a
/// domain, and no peer is named.
#[test]
fn multicast_finds_peers_on_the_interfaces_that_are_named() {
    let _dog = watchdog("multicast", Duration::from_secs(60));
    let config = RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Subnet,
        interfaces: vec![[127, 0, 0, 1].into()],
        ..RtpsConfig::default()
    };
    let both = [(); 2].map(|()| Rtps::open(&config).unwrap());
    while both.iter().any(|one| one.stats().participants == 0) {
        for one in &both {
            let deadline = replenish_os::clock::monotonic() + 5_000_000;
            one.wait(&Interest::empty(), Some(deadline)).unwrap();
            one.take(&mut Interest::empty(), &mut |_, _, _| Room::Left)
                .unwrap();
        }
    }
}

/// Another program of this host has joined the group on another interface.
#[test]
fn multicast_of_an_interface_that_is_not_named_is_not_heard() {
    let _dog = watchdog("multicast elsewhere", Duration::from_secs(60));
    let mut elsewhere = None;
    replenish_os::host_addresses(|ip, _| match ip {
        std::net::IpAddr::V4(ip) if !ip.is_loopback() => elsewhere = Some(ip),
        _ => {}
    })
    .unwrap();
    let Some(elsewhere) = elsewhere else {
        return; // there is loopback alone
    };
    let config = RtpsConfig {
        range: DiscoveryRange::Subnet,
        ..config()
    };
    let rtps = Rtps::open(&config).unwrap();
    let (group, port) = ([239, 255, 0, 1].into(), 7400 + 250 * config.domain);
    for (from, heard) in [(elsewhere, false), (std::net::Ipv4Addr::LOCALHOST, true)] {
        // One that is bound to an address sends to groups from its interface.
        let other = std::net::UdpSocket::bind((from, 0)).unwrap();
        other.join_multicast_v4(&group, &from).unwrap();
        other.send_to(b"no RTPS", (group, port)).unwrap();
        let before = rtps.stats().malformed;
        for _ in 0..20 {
            let deadline = clock::monotonic() + 5_000_000;
            rtps.wait(&Interest::empty(), Some(deadline)).unwrap();
            rtps.take(&mut Interest::empty(), &mut |_, _, _| Room::Left)
                .unwrap();
        }
        assert_eq!(rtps.stats().malformed > before, heard, "from {from}");
    }
}

#[test]
fn limits_on_peers_are_refused() {
    let node = node(&open(&config()), "n");
    let (mut exec, _) = executor(node.context());
    let limit = IngressLimit::none().bytes_per_second(1000);
    let topic = Topic::named("t").ingress_limit(limit);
    let refused = exec
        .worker("w")
        .subscribe(&node, topic, Qos::reliable(), |_: &Int32, _| ());
    assert!(matches!(
        refused.err(),
        Some(Error::Middleware {
            source: MiddlewareError::Unsupported(_),
            ..
        })
    ));
}

#[test]
fn settings_out_of_range_name_their_field() {
    let told = |config: &RtpsConfig| Rtps::open(config).err().unwrap().to_string();
    let far = RtpsConfig {
        domain: 233,
        ..config()
    };
    assert_eq!(told(&far), "domain = 233 is not allowed: 0 to 232");
    let nowhere = RtpsConfig {
        static_peers: vec!["nowhere.invalid".into()],
        ..config()
    };
    assert!(told(&nowhere).contains("\"nowhere.invalid\" has no address that can be used"));
}

/// Two clients of one service in another participant, or in the server's own.
#[test]
fn services_answer_each_request_once() {
    let _dog = watchdog("services", Duration::from_secs(60));
    let config = config();
    for same in [false, true] {
        let served = open(&config);
        let asking = if same { served.clone() } else { open(&config) };
        let (server, (mut exec, _)) = (node(&served, "server"), executor(&served));
        let serve = |exec: &mut Executor| {
            exec.worker("server")
                .serve::<Echo, _>(&server, "echo", Qos::services(), |m, answer, _| {
                    answer.data = m.data + 1;
                })
                .unwrap();
        };
        serve(&mut exec);
        let mut running = Vec::new();
        if !same {
            running.push(exec.start().unwrap());
            exec = executor(&asking).0;
        }
        let limit = Duration::from_secs(30);
        let asker = node(&asking, "client");
        let clients = ["a", "b"].map(|name| {
            let client = asker
                .client::<Echo>("echo", Qos::services(), limit)
                .unwrap();
            let answers = Arc::new(Mutex::new(Vec::new()));
            let sink = Arc::clone(&answers);
            exec.worker(name)
                .replies(&client, move |reply: Result<&Int32, _>, _| {
                    sink.lock().unwrap().push(reply.unwrap().data);
                })
                .unwrap();
            (client, answers)
        });
        running.push(exec.start().unwrap());
        for (client, _) in &clients {
            assert!(client.wait_for_server(limit).unwrap());
        }
        for data in 0..50 {
            for (number, (client, _)) in (0..).zip(&clients) {
                client
                    .call(&Int32 {
                        data: data + 1000 * number,
                    })
                    .unwrap();
            }
            let count = usize::try_from(data).unwrap() + 1;
            let all = || {
                clients
                    .iter()
                    .all(|(_, answers)| answers.lock().unwrap().len() == count)
            };
            assert!(eventually(all));
        }
        for (number, (_, answers)) in (0..).zip(&clients) {
            let expected: Vec<_> = (1..=50).map(|data| data + 1000 * number).collect();
            assert_eq!(
                *answers.lock().unwrap(),
                expected,
                "same participant: {same}"
            );
        }
        drop(running);
    }
}

#[test]
fn peers_of_two_participants_are_counted() {
    let config = config();
    crate::matching::peers_are_counted(&open(&config), &open(&config));
}

#[test]
fn two_participants_know_the_graph() {
    let config = config();
    crate::matching::the_graph_is_known(&open(&config), &open(&config));
}
