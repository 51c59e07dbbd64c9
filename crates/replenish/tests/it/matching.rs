//! Endpoints that do not fit together say so, and which policy clashes; clients know whether their
//! service has a server. In one process and through an agent.

use crate::common::agent::TestAgent;
use crate::common::{Log, eventually, executor};
use replenish::msg::Service;
use replenish::msg::std_msgs::Int32;
use replenish::{
    Client, Context, Error, Event, HandleOptions, Node, Qos, Removal, RunningExecutor,
};
use replenish_interfaces::std_srvs::srv::SetBool;
use replenish_testkit::watchdog::watchdog;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// Squares a number.
struct Square;

impl Service for Square {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = "test_msgs/srv/Square";
}

fn told(log: &Log, endpoint: &str, clash: &str) -> bool {
    let lines = log.lines();
    let of = |line: &&String| line.starts_with(endpoint) && line.contains("not compatible");
    let told: Vec<&String> = lines.iter().filter(of).collect();
    assert!(told.len() <= 1, "told once: {lines:?}");
    told.first().is_some_and(|line| line.contains(clash))
}

/// A publisher that offers little, a subscription that asks for much, another that does not; then
/// the other way round in time. Both ends get the event, the handle's own hook too, and what does
/// not match hears nothing.
fn clashes_are_told(publishing: &Context, subscribing: &Context) {
    let _dog = watchdog("clashes", LIMIT);
    let here = publishing.node("here").unwrap();
    let there = subscribing.node("there").unwrap();
    let out = here
        .publisher::<Int32>("first", Qos::best_effort())
        .unwrap();
    let (mut exec, log) = executor(subscribing);
    let hooked = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&hooked);
    let hook = move |event: &Event<'_>| {
        let Event::Incompatible { endpoint, clash } = event else {
            return;
        };
        assert_eq!((*endpoint, clash.topic()), ("/there/sub:/first", "/first"));
        assert!(clash.policies().eq(["reliability", "durability"]));
        count.fetch_add(1, Ordering::SeqCst);
    };
    let ignore = |_: &Int32, _: &replenish::CallbackContext<'_>| ();
    exec.worker("w")
        .subscribe(&there, "first", Qos::latched(), ignore)
        .unwrap()
        .options(HandleOptions::new().on_error(hook))
        .subscribe(&there, "first", Qos::best_effort(), ignore)
        .unwrap()
        .subscribe(
            &there,
            "second",
            Qos::best_effort().deadline(5 * MS),
            ignore,
        )
        .unwrap();
    let running = exec.start().unwrap();
    let (mut other, there_log) = executor(publishing);
    other.worker("idle").capacity(1);
    // One context has one executor.
    let _spins = other.start().ok();
    let second = here.publisher::<Int32>("second", Qos::reliable()).unwrap();

    let weak = "reliability BestEffort is offered, Reliable requested; \
                durability Volatile is offered, TransientLocal requested";
    assert!(
        eventually(|| told(&log, "/there/sub:/first:", weak)),
        "{:?}",
        log.lines()
    );
    assert!(eventually(|| hooked.load(Ordering::SeqCst) == 1));
    let slow = "deadline";
    assert!(eventually(|| told(&log, "/there/sub:/second:", slow)));
    let heard_by_publisher = |name: &str, what: &str| {
        let either = [&log, &there_log];
        either.iter().any(|log| told(log, name, what))
    };
    assert!(eventually(|| heard_by_publisher("publisher /first:", weak)));
    assert!(eventually(|| heard_by_publisher(
        "publisher /second:",
        slow
    )));

    let stats = |id: &str| running.stats(id).unwrap();
    assert!(eventually(|| {
        out.publish(&Int32 { data: 1 }).unwrap();
        second.publish(&Int32 { data: 1 }).unwrap();
        stats("/there/sub:/first#2").executed >= 5
    }));
    assert_eq!(stats("/there/sub:/first").received, 0);
    assert_eq!(stats("/there/sub:/second").received, 0);
}

#[test]
fn clashes_are_told_to_both_ends_in_one_process() {
    let ctx = Context::in_process();
    clashes_are_told(&ctx, &ctx);
    let bus = replenish::middleware::InProcessBus::new();
    let (a, b) = (bus.participant(), bus.participant());
    clashes_are_told(&Context::new(a), &Context::new(b));
}

#[test]
fn clashes_are_told_to_both_ends_through_the_agent() {
    let agent = TestAgent::start("127.0.0.1:0");
    clashes_are_told(&agent.context(), &agent.context());
}

/// In ROS 2 a best-effort client and a reliable server do not talk.
#[test]
fn a_client_that_offers_too_little_is_told_and_has_no_server() {
    let _dog = watchdog("client", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, log) = executor(&ctx);
    exec.worker("w")
        .serve::<Square, _>(&node, "square", Qos::services(), |_, _, _| ())
        .unwrap();
    let weak = node.client::<Square>("square", Qos::best_effort(), LIMIT);
    let weak: Client<Square> = weak.unwrap();
    let strong: Client<Square> = node.client("square", Qos::services(), LIMIT).unwrap();
    let _running = exec.start().unwrap();
    let reliability = "reliability BestEffort is offered, Reliable requested";
    assert!(eventually(|| told(&log, "client /square:", reliability)));
    assert_eq!(weak.wait_for_server(MS), Ok(false));
    assert_eq!(strong.wait_for_server(LIMIT), Ok(true));
}

/// The other way round: a reliable client hears nothing from a server that answers with best
/// effort, although that one hears the client. Both get an event, and the client has no server.
#[test]
fn a_server_that_offers_too_little_is_told_and_its_replies_are_not_heard() {
    let _dog = watchdog("server", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, log) = executor(&ctx);
    let client: Client<Square> = node.client("square", Qos::services(), 100 * MS).unwrap();
    let (call, replies) = (client.clone(), Arc::new(AtomicU64::new(0)));
    let count = Arc::clone(&replies);
    exec.worker("w")
        .serve::<Square, _>(&node, "square", Qos::best_effort(), |_, _, _| ())
        .unwrap()
        .replies(&client, move |reply, _| {
            assert_eq!(reply.err(), Some(replenish::NoReply::TimedOut));
            count.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let reliability = "reliability BestEffort is offered, Reliable requested";
    for end in ["server /square:", "/n/cli:/square:"] {
        assert!(eventually(|| told(&log, end, reliability)), "{end}");
    }
    assert_eq!(client.wait_for_server(MS), Ok(false));
    call.call(&Int32 { data: 3 }).unwrap();
    assert!(eventually(|| replies.load(Ordering::SeqCst) == 1));
    assert_eq!(running.stats("/n/srv:/square").unwrap().executed, 1);
}

/// A server that is not there, comes, goes with its handle, comes again and goes with its client.
fn servers_come_and_go(asking: &Context, serving: &Context) {
    let _dog = watchdog("servers", LIMIT);
    let node = asking.node("asks").unwrap();
    let client: Client<Square> = node.client("square", Qos::services(), LIMIT).unwrap();
    assert_eq!(client.wait_for_server(50 * MS), Ok(false));
    let node = serving.node("serves").unwrap();
    let serve = || {
        let (mut exec, _) = executor(serving);
        exec.worker("w")
            .serve::<Square, _>(&node, "square", Qos::services(), |_, _, _| ())
            .unwrap()
            .timer(MS, |_| ())
            .unwrap();
        exec.start().unwrap()
    };
    let running = serve();
    assert_eq!(client.wait_for_server(LIMIT), Ok(true));
    let gone = || client.wait_for_server(Duration::ZERO) == Ok(false);
    let remove = Removal::Wait(LIMIT);
    running
        .handle()
        .remove("/serves/srv:/square", remove)
        .unwrap();
    assert!(eventually(gone));
    drop(running);
    let _running = serve();
    // Here a thread spins the client's context meanwhile.
    let (mut exec, _) = executor(asking);
    exec.worker("w").replies(&client, |_, _| ()).unwrap();
    let spins = exec.start().unwrap();
    assert_eq!(client.wait_for_server(LIMIT), Ok(true));
    assert!(!gone());
    drop(spins);
}

#[test]
fn clients_wait_for_servers_in_one_process() {
    let bus = replenish::middleware::InProcessBus::new();
    let (a, b) = (bus.participant(), bus.participant());
    servers_come_and_go(&Context::new(a), &Context::new(b));
}

#[test]
fn clients_wait_for_servers_through_the_agent() {
    let agent = TestAgent::start("127.0.0.1:0");
    let asking = agent.context();
    servers_come_and_go(&asking, &agent.context());
    // A server goes with its whole session, too.
    let node = asking.node("last").unwrap();
    let client: Client<Square> = node.client("square", Qos::services(), LIMIT).unwrap();
    let other = agent.context();
    let (mut exec, _) = executor(&other);
    exec.worker("w")
        .serve::<Square, _>(
            &other.node("s").unwrap(),
            "square",
            Qos::services(),
            |_, _, _| (),
        )
        .unwrap();
    assert_eq!(client.wait_for_server(LIMIT), Ok(true));
    drop((exec, other));
    assert!(eventually(
        || client.wait_for_server(Duration::ZERO) == Ok(false)
    ));
}

/// An agent that does not know what our clients ask for at log-in, as others do not: a relay spoils
/// the name of that property.
#[test]
fn an_agent_that_does_not_tell_of_servers_is_an_error_that_says_so() {
    let _dog = watchdog("foreign agent", LIMIT);
    let agent = TestAgent::start("127.0.0.1:0");
    let front = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = front.local_addr().unwrap().to_string();
    let stop = Arc::new(AtomicBool::new(false));
    let done = Arc::clone(&stop);
    let relay = std::thread::spawn(move || {
        let back = UdpSocket::bind("127.0.0.1:0").unwrap();
        back.connect(agent.address).unwrap();
        for socket in [&front, &back] {
            socket.set_read_timeout(Some(MS)).unwrap();
        }
        let (mut buf, mut client) = ([0; 2048], None);
        let end = Instant::now() + LIMIT;
        while !done.load(Ordering::SeqCst) && Instant::now() < end {
            if let Ok((len, from)) = front.recv_from(&mut buf) {
                client = Some(from);
                let name = b"replenish.delivery";
                let found = buf[..len].windows(name.len()).position(|w| w == name);
                found.into_iter().for_each(|at| buf[at] = b'x');
                back.send(&buf[..len]).unwrap();
            }
            if let (Ok(len), Some(client)) = (back.recv(&mut buf), client) {
                front.send_to(&buf[..len], client).unwrap();
            }
        }
    });
    let ctx = Context::xrce_udp(&address).unwrap();
    let node = ctx.node("n").unwrap();
    let client: Client<Square> = node.client("square", Qos::services(), LIMIT).unwrap();
    let error = client.wait_for_server(LIMIT).unwrap_err();
    assert!(matches!(error, Error::Middleware { .. }));
    let text = error.to_string();
    let graph = node.graph().unwrap_err().to_string();
    assert!(
        graph.contains("to know the graph, which no agent tells"),
        "{graph}"
    );
    node.best_available_subscription("t").unwrap_err();
    assert!(
        text.contains("client /square") && text.contains("this agent does not tell"),
        "{text}"
    );
    drop((client, node, ctx));
    stop.store(true, Ordering::SeqCst);
    relay.join().unwrap();
}

/// A publisher and a subscription know how many peers they have, as those come and go.
pub(crate) fn peers_are_counted(publishing: &Context, subscribing: &Context) {
    let _dog = watchdog("peers", LIMIT);
    let here = publishing.node("here").unwrap();
    let there = subscribing.node("there").unwrap();
    let out = here.publisher::<Int32>("t", Qos::best_effort()).unwrap();
    assert_eq!(out.subscriptions(), Some(0));
    assert_eq!(out.wait_for_subscription(MS), Ok(false));
    let (mut exec, _) = executor(subscribing);
    exec.worker("w")
        .subscribe(&there, "t", Qos::best_effort(), |_: &Int32, _| ())
        .unwrap()
        .subscribe(&there, "other", Qos::best_effort(), |_: &Int32, _| ())
        .unwrap()
        .timer(MS, |_| ())
        .unwrap();
    // It does not fit, and is no peer.
    exec.worker("strict")
        .subscribe(&there, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    assert_eq!(out.wait_for_subscription(LIMIT), Ok(true));
    assert_eq!(change.wait_for_publisher("/there/sub:/t", LIMIT), Ok(true));
    assert_eq!(out.subscriptions(), Some(1));
    let matched = |id: &str| {
        let report = running.report();
        report
            .handles
            .iter()
            .find(|h| h.id.starts_with(id))
            .unwrap()
            .matched
    };
    let of = "/there/sub:/t";
    assert!(eventually(|| matched(of) == Some(1)));
    assert_eq!(matched("/there/sub:/other"), Some(0));
    assert_eq!(matched("w/timer:0"), None);
    waits_for_publishers(&running, &here);
    let second = here.publisher::<Int32>("t", Qos::reliable()).unwrap();
    assert!(eventually(|| matched(of) == Some(2)));
    assert!(eventually(|| second.subscriptions() == Some(2)));
    drop(out);
    assert!(eventually(|| matched(of) == Some(1)));
    let gone = running.handle().remove(of, Removal::Wait(LIMIT));
    assert!(gone.is_ok(), "{gone:?}");
    assert!(eventually(|| second.subscriptions() == Some(1)));
    drop(running.stop());
}

/// A subscription waits for a publisher that fits; who has no publishers is refused.
fn waits_for_publishers(running: &RunningExecutor, here: &Node) {
    let change = running.handle();
    let strict = "/there/sub:/t#2";
    assert_eq!(change.publishers("/there/sub:/t"), Ok(Some(1)));
    assert_eq!(change.publishers(strict), Ok(Some(0)));
    assert_eq!(change.wait_for_publisher(strict, MS), Ok(false));
    let comes = thread::scope(|scope| {
        let waits = scope.spawn(|| change.wait_for_publisher("/there/sub:/other", LIMIT));
        let other = here.publisher::<Int32>("other", Qos::best_effort());
        let comes = waits.join().unwrap();
        drop(other.unwrap());
        comes
    });
    assert_eq!(comes, Ok(true));
    let none = change.wait_for_publisher("nobody", LIMIT);
    assert_eq!(none, Err(Error::UnknownHandle("nobody".into())));
    let timer = change.wait_for_publisher("w/timer:0", LIMIT).unwrap_err();
    let timer = timer.to_string();
    assert!(timer.contains("the id of a subscription"), "{timer}");
}

#[test]
fn peers_are_counted_in_one_process() {
    let ctx = Context::in_process();
    peers_are_counted(&ctx, &ctx);
}

/// Both ends see the topics and services of both, with types and qualities, until they go.
pub(crate) fn the_graph_is_known(one: &Context, other: &Context) {
    let _dog = watchdog("graph", LIMIT);
    let here = one.node("here").unwrap();
    let there = other.node("there").unwrap();
    let strict = Qos::reliable().transient_local().deadline(100 * MS);
    let out = here.publisher::<Int32>("t", strict).unwrap();
    let client: Client<SetBool> = here.client("set", Qos::services(), LIMIT).unwrap();
    let (mut exec, _) = executor(other);
    exec.worker("w")
        .subscribe(&there, "t", Qos::sensor_data(), |_: &Int32, _| ())
        .unwrap()
        .serve::<SetBool, _>(&there, "set", Qos::services(), |_, _, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    for node in [&here, &there] {
        assert!(eventually(|| {
            let graph = node.graph().unwrap();
            let service = graph.service("/set");
            let ends = graph
                .topic("/t")
                .map(|t| (t.publishers.len(), t.subscriptions.len()));
            ends == Some((1, 1)) && service.is_some_and(|s| (s.servers, s.clients) == (1, 1))
        }));
        assert!(
            eventually(|| {
                let graph = node.graph().unwrap();
                let has = |name: &str| {
                    graph.node(name).map(|n| {
                        [&n.publishers, &n.subscriptions, &n.clients, &n.servers].map(Vec::len)
                    })
                };
                let (one, other) = (has("/here"), has("/there"));
                one.is_some_and(|n| n[2] == 1 && n[3] == 0)
                    && other.is_some_and(|n| n[2] == 0 && n[3] == 1)
            }),
            "{:?}",
            node.graph()
        );
        let graph = node.graph().unwrap();
        let topic = graph.topic("/t").unwrap();
        assert_eq!(topic.type_name, "std_msgs/msg/Int32");
        let [offered, asked] = [topic.publishers[0], topic.subscriptions[0]];
        assert_eq!(
            (offered.reliability, offered.durability),
            (strict.reliability, strict.durability)
        );
        assert_eq!(offered.deadline, strict.deadline);
        assert_eq!(node.best_available_subscription("t"), Ok(strict));
        let latched = Qos::reliable().transient_local();
        assert_eq!(node.best_available_publisher("/t"), Ok(latched));
        assert_eq!(asked.reliability, Qos::sensor_data().reliability);
        assert_eq!(
            graph.service("/set").unwrap().type_name,
            "std_srvs/srv/SetBool"
        );
        assert!(
            graph.topics.iter().all(|t| t.name.starts_with('/')),
            "{graph:?}"
        );
    }
    drop((out, client, here));
    assert!(eventually(|| {
        let graph = there.graph().unwrap();
        let left = graph.topic("/t").map(|t| t.publishers.len());
        let named = |name| graph.nodes.iter().any(|node| node.name == name);
        left == Some(0)
            && graph.service("/set").is_some_and(|s| s.servers == 1)
            && named("there")
            && !named("here")
    }));
    drop(running.stop());
}

#[test]
fn the_graph_is_known_in_one_process() {
    let ctx = Context::in_process();
    the_graph_is_known(&ctx, &ctx);
}

/// The quality that is chosen for a subscription fits every publisher. It is strict where the
/// publishers agree.
#[test]
fn the_best_available_quality_fits_every_publisher() {
    let loose = Qos::sensor_data();
    let strict = Qos::reliable().transient_local().deadline(20 * MS);
    let slow = strict.deadline(50 * MS);
    let latched = Qos::reliable().transient_local();
    let rows: [(&[Qos], Qos); 6] = [
        (&[], latched),
        (&[loose], Qos::best_effort()),
        (&[strict], strict),
        (&[strict, slow], slow),
        (&[strict, loose], Qos::best_effort()),
        (&[Qos::reliable(), latched], Qos::reliable()),
    ];
    for (offered, chosen) in rows {
        let node = Context::in_process().node("n").unwrap();
        let publishers: Vec<_> = offered
            .iter()
            .map(|qos| node.publisher::<Int32>("t", *qos).unwrap())
            .collect();
        let asked = node.best_available_subscription("t").unwrap();
        assert_eq!(asked, chosen, "{offered:?}");
        for qos in offered {
            assert_eq!(qos.check_offers(asked), Ok(()), "{offered:?}");
        }
        drop(publishers);
    }
}

#[test]
fn no_agent_tells_of_subscriptions() {
    let agent = TestAgent::start("127.0.0.1:0");
    let node = agent.context().node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    assert_eq!(out.subscriptions(), None);
    let error = out.wait_for_subscription(MS).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("subscriptions, which no agent tells"),
        "{text}"
    );
    let ctx = agent.context();
    let node = ctx.node("hears").unwrap();
    let (mut exec, _) = executor(&ctx);
    let worker = exec.worker("w");
    let worker = worker.subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ());
    let id = worker.unwrap().added_ids().remove(0);
    let change = exec.start().unwrap().handle();
    assert_eq!(change.publishers(&id), Ok(None));
    let text = change.wait_for_publisher(&id, MS).unwrap_err().to_string();
    let told = "subscription /hears/sub:/t";
    assert!(
        text.contains(told) && text.contains("publishers, which no agent tells"),
        "{text}"
    );
}
