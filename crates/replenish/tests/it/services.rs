//! Services: request ids, replies now and later, time limits, and what goes wrong; in one process
//! and through an agent.

use crate::common::{eventually, executor};
use replenish::msg::Service;
use replenish::msg::std_msgs::{Int32, Int64};
use replenish::{
    CallError, Client, Context, HandleOptions, NoReply, PublishError, Qos, Removal, Responder,
};
use replenish_testkit::watchdog::watchdog;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// Squares a number.
pub(crate) struct Square;

impl Service for Square {
    type Request = Int32;
    type Response = Int64;
    const TYPE_NAME: &'static str = "test_msgs/srv/Square";
}

fn square(request: &Int32) -> Int64 {
    Int64 {
        data: i64::from(request.data) * i64::from(request.data),
    }
}

/// Two clients of one server: each gets its own replies, each exactly once.
fn replies_find_their_requests(server: &Context, clients: &Context, services: u64) {
    let _dog = watchdog("services", LIMIT);
    let node = server.node("server").unwrap();
    let (mut serving, _) = executor(server);
    serving
        .worker("serve")
        .serve::<Square, _>(&node, "square", Qos::reliable(), |request, response, cx| {
            assert_ne!(cx.request().0, [0; 24]);
            *response = square(request);
        })
        .unwrap();
    let node = clients.node("clients").unwrap();
    let (mut calling, _) = executor(clients);
    let got = Arc::new(Mutex::new(BTreeMap::new()));
    let mut callers: Vec<Client<Square>> = Vec::new();
    for i in 0..2_u64 {
        let client = node.client("square", Qos::reliable(), LIMIT).unwrap();
        assert_eq!(client.call(&Int32::default()), Err(CallError::NoCallback));
        let note = Arc::clone(&got);
        calling
            .worker(&format!("replies{i}"))
            .replies::<Square, _, _>(&client, move |reply, cx| {
                let data = reply.unwrap().data;
                let twice = note
                    .lock()
                    .unwrap()
                    .insert((i, cx.request().number()), data);
                assert_eq!(twice, None);
            })
            .unwrap();
        callers.push(client);
    }
    let (serving, calling) = (serving.start().unwrap(), calling.start().unwrap());
    let mut expected = BTreeMap::new();
    for data in 0..20 {
        for (client, i) in callers.iter().zip(0..) {
            let request = Int32 { data: data * 2 + i };
            let number = client.call(&request).unwrap();
            let who = u64::try_from(i).unwrap();
            assert_eq!(expected.insert((who, number), square(&request).data), None);
            let all = || got.lock().unwrap().len() == expected.len();
            assert!(eventually(all), "{data} of client {i}");
        }
    }
    assert_eq!(*got.lock().unwrap(), expected);
    let served = serving.stop().handle("/server/srv:/square").unwrap().stats;
    assert_eq!((served.executed, served.errors), (services, 0));
    for handle in calling.stop().handles {
        assert_eq!((handle.stats.received, handle.stats.executed), (20, 20));
    }
}

#[test]
fn replies_find_their_requests_in_one_process() {
    let bus = replenish::middleware::InProcessBus::new();
    let contexts = [(); 2].map(|()| Context::new(bus.participant()));
    replies_find_their_requests(&contexts[0], &contexts[1], 40);
}

#[cfg(feature = "xrce")]
#[test]
fn replies_find_their_requests_through_the_agent() {
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    replies_find_their_requests(&agent.context(), &agent.context(), 40);
}

type Waiting = Arc<Mutex<Vec<(Int32, Responder<Square>)>>>;

/// A reply may come after the callback, from another thread, and in another order.
#[test]
fn replies_may_come_later_and_in_any_order() {
    let _dog = watchdog("deferred replies", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let waiting: Waiting = Arc::default();
    let keep = Arc::clone(&waiting);
    exec.worker("serve")
        .serve_later::<Square, _, _>(
            &node,
            "square",
            Qos::reliable(),
            move |request, responder, _| keep.lock().unwrap().push((*request, responder)),
        )
        .unwrap();
    let client: Client<Square> = node.client("square", Qos::reliable(), LIMIT).unwrap();
    let got = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&got);
    exec.worker("call")
        .replies::<Square, _, _>(&client, move |reply, cx| {
            let data = reply.unwrap().data;
            note.lock().unwrap().push((cx.request().number(), data));
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(client.wait_for_server(LIMIT).unwrap());
    let numbers: Vec<u64> = (1..=3)
        .map(|data| client.call(&Int32 { data }).unwrap())
        .collect();
    assert!(eventually(|| waiting.lock().unwrap().len() == 3));
    for _ in 0..3 {
        let (request, responder) = waiting.lock().unwrap().pop().unwrap();
        responder.reply(&square(&request)).unwrap();
    }
    assert!(eventually(|| got.lock().unwrap().len() == 3));
    let expected: Vec<_> = numbers.iter().copied().zip([1, 4, 9]).rev().collect();
    assert_eq!(*got.lock().unwrap(), expected);
    drop(running);
}

/// Without a reply the callback learns so once, and a reply that comes later is left out.
#[test]
fn a_request_without_reply_ends_at_its_limit_and_so_many_may_wait() {
    let _dog = watchdog("time limits", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let late: Arc<Mutex<Vec<Responder<Square>>>> = Arc::default();
    let keep = Arc::clone(&late);
    exec.worker("serve")
        .serve_later::<Square, _, _>(&node, "square", Qos::reliable(), move |_, to, _| {
            keep.lock().unwrap().push(to);
        })
        .unwrap();
    let two = Qos::reliable().keep_last(2);
    let client: Client<Square> = node.client("square", two, 1000 * MS).unwrap();
    let expired = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&expired);
    exec.worker("call")
        .replies::<Square, _, _>(&client, move |reply, cx| {
            assert_eq!(reply, Err(NoReply::TimedOut));
            assert!(cx.started() >= cx.due());
            count.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap();
    let running = exec.start().unwrap();
    client.call(&Int32::default()).unwrap();
    client.call(&Int32::default()).unwrap();
    let third = client.call(&Int32::default());
    assert_eq!(third, Err(CallError::TooMany { limit: 2 }));
    assert!(eventually(|| expired.load(Ordering::Relaxed) == 2));
    assert!(eventually(|| late.lock().unwrap().len() == 2));
    for to in late.lock().unwrap().drain(..) {
        to.reply(&Int64::default()).unwrap();
    }
    let stats = || running.stats("/n/cli:/square").unwrap();
    assert!(eventually(|| stats().discarded == 2));
    assert_eq!((stats().executed, stats().received), (2, 4));
    client.call(&Int32::default()).unwrap(); // there is room again
}

/// rclc defect 2: a reply that cannot be sent ended the spin.
#[test]
fn a_reply_to_a_client_that_is_gone_is_told_and_counted_and_the_service_goes_on() {
    let _dog = watchdog("dead client", LIMIT);
    let mw = crate::common::scripted::Scripted::default();
    let ctx = Context::new(mw.clone());
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let told = Arc::new(AtomicU64::new(0));
    let tell = Arc::clone(&told);
    exec.worker("serve")
        .serve::<Square, _>(&node, "square", Qos::reliable(), |request, response, _| {
            *response = square(request);
        })
        .unwrap()
        .options(HandleOptions::new().on_error(move |_| {
            tell.fetch_add(1, Ordering::Relaxed);
        }));
    let running = exec.start().unwrap();
    let request = [1, 0, 0, 0]; // the script's `reply` says that the link is down
    for _ in 0..3 {
        mw.put(0, &request);
    }
    mw.put(0, &request[..2]); // undecodable
    mw.put(0, &request);
    let stats = || running.stats("/n/srv:/square").unwrap();
    assert!(eventually(
        || stats().executed == 4 && stats().undecodable == 1
    ));
    assert_eq!(stats().errors, 4);
    let told = || told.load(Ordering::Relaxed);
    assert!(
        eventually(|| told() == 5),
        "each time, not rarely: {}",
        told()
    );
}

/// A client goes before its answer comes, and another takes its place in the middleware: the answer
/// is for neither, and the server gets an error.
#[test]
fn a_late_reply_does_not_reach_the_client_that_came_after() {
    let _dog = watchdog("late reply", LIMIT);
    let bus = replenish::middleware::InProcessBus::new();
    let (serving, asking) = (
        Context::new(bus.participant()),
        Context::new(bus.participant()),
    );
    let node = serving.node("s").unwrap();
    let (mut exec, _) = executor(&serving);
    let (keep, kept) = std::sync::mpsc::channel();
    exec.worker("serve")
        .serve_later::<Square, _, _>(&node, "square", Qos::services(), move |_, to, _| {
            keep.send(to).unwrap();
        })
        .unwrap();
    let _serves = exec.start().unwrap();
    let node = asking.node("n").unwrap();
    let (mut exec, _) = executor(&asking);
    exec.worker("c").capacity(1);
    let running = exec.start().unwrap();
    let change = running.handle();
    let mut responders = Vec::new();
    for gone in [true, false] {
        let client = node.client::<Square>("square", Qos::services(), LIMIT);
        let client = client.unwrap();
        let worker = change.worker("c").unwrap();
        let id = worker.replies(&client, |_, _| ()).unwrap();
        client.call(&Int32 { data: 3 }).unwrap();
        responders.push(kept.recv().unwrap());
        if gone {
            change.remove(&id, Removal::Wait(LIMIT)).unwrap();
        }
    }
    let replies = responders
        .into_iter()
        .map(|to| to.reply(&Int64 { data: 9 }));
    let outcomes: Vec<_> = replies.collect();
    assert_eq!(outcomes, [Err(PublishError::LinkDown), Ok(())]);
    let stats = || running.stats("/n/cli:/square").unwrap();
    assert!(eventually(|| stats().executed == 1));
    assert_eq!((stats().received, stats().discarded), (1, 0));
}

/// As `Square`, by name; its response is shorter.
struct Other;

impl Service for Other {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = Square::TYPE_NAME;
}

/// A reply that is none is an answer all the same: the callback hears of it, once, with the field.
#[test]
fn a_reply_that_cannot_be_decoded_ends_its_request() {
    let _dog = watchdog("undecodable reply", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.worker("s")
        .serve::<Other, _>(&node, "square", Qos::services(), |_, _, _| ())
        .unwrap();
    let client: Client<Square> = node
        .client("square", Qos::services().keep_last(1), LIMIT)
        .unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&heard);
    exec.worker("c")
        .replies(&client, move |reply, cx| {
            let why = reply.map(|r| r.data).map_err(|e| e.to_string());
            note.lock().unwrap().push((cx.request().number(), why));
        })
        .unwrap();
    let running = exec.start().unwrap();
    let mut numbers = Vec::new();
    for n in 1..=3 {
        numbers.push(client.call(&Int32 { data: 1 }).unwrap()); // its one place is free again
        assert!(eventually(|| heard.lock().unwrap().len() == n));
    }
    let heard = heard.lock().unwrap();
    for (number, (of, why)) in numbers.iter().zip(heard.iter()) {
        assert_eq!(number, of);
        let text = "the reply cannot be decoded: data: needs 8 bytes, 4 left";
        assert_eq!(why.as_ref().unwrap_err(), text);
    }
    let stats = running.stop().handle("/n/cli:/square").unwrap().stats;
    assert_eq!((stats.undecodable, stats.executed), (3, 3));
    assert_eq!(stats.received, stats.undecodable + stats.executed);
}

/// A request whose reply no client would hear is an error of its sender: however the callback has
/// gone, and at once.
#[test]
fn a_call_without_an_executor_any_more_is_an_error() {
    let _dog = watchdog("gone", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let client = || -> Client<Square> { node.client("square", Qos::reliable(), LIMIT).unwrap() };
    let exec = |client: &Client<Square>| {
        let (mut exec, _) = executor(&ctx);
        let worker = exec.worker("w").capacity(2);
        let called = |_: Result<&Int64, NoReply>, _: &replenish::CallbackContext<'_>| {
            panic!("the handle has stopped")
        };
        worker.replies::<Square, _, ()>(client, called).unwrap();
        exec
    };
    let call = |client: &Client<Square>| client.call(&Int32::default()).map(|_| ());

    let never_started = client();
    drop(exec(&never_started));
    assert_eq!(call(&never_started), Err(CallError::Gone));

    let without_threads = client();
    let local = exec(&without_threads).local().unwrap();
    assert_eq!(call(&without_threads), Ok(()));
    drop(local);
    assert_eq!(call(&without_threads), Err(CallError::Gone));

    let stopped = client();
    let running = exec(&stopped).start().unwrap();
    assert_eq!(call(&stopped), Ok(()));
    running.stop();
    let error = call(&stopped).unwrap_err();
    assert_eq!(error, CallError::Gone);
    assert!(
        error.to_string().contains("its executor has ended"),
        "{error}"
    );

    let removed = client();
    let running = exec(&removed).start().unwrap();
    let handle = running.handle();
    handle.remove("/n/cli:/square", Removal::Detach).unwrap();
    assert_eq!(call(&removed), Err(CallError::Gone));
    drop(running);

    let panicked = client();
    let mut exec = exec(&panicked);
    let serve = |_: &Int32, _: &mut Int64, _: &replenish::CallbackContext<'_>| ();
    let worker = exec.worker("serve");
    worker
        .serve::<Square, _>(&node, "square", Qos::reliable(), serve)
        .unwrap();
    let running = exec.start().unwrap();
    assert_eq!(call(&panicked), Ok(()));
    assert!(eventually(|| running
        .stats("/n/cli:/square")
        .unwrap()
        .panicked));
    assert!(eventually(|| call(&panicked) == Err(CallError::Gone)));
}
