//! Services: one worker adds numbers at once, another takes its time and answers later; a third
//! asks both, and hears of every request exactly once: its reply, or that none has come in time.
//!
//! Run: `cargo run -p replenish --example services` in one process; with an agent's address
//! (`127.0.0.1:8888`) behind it, through that agent.

use replenish::{CallbackContext, Context, Error, Every, Executor, NoReply, Qos};
use replenish_interfaces::example_interfaces::srv::{
    AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse,
};
use std::sync::mpsc;
use std::time::Duration;

fn main() -> Result<(), Error> {
    let ms = Duration::from_millis;
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let node = ctx.node("adder")?;
    let qos = Qos::reliable();
    let mut exec = Executor::new(&ctx);

    // At once: the response is filled in the callback.
    exec.worker("quick")
        .serve::<AddTwoInts, _>(&node, "add", qos, |ints, answer, _| {
            answer.sum = ints.a + ints.b;
        })?;

    // Later: a responder is the right to answer, from any callback or thread.
    let (defer, deferred) = mpsc::channel();
    exec.worker("slow")
        .serve_later::<AddTwoInts, _, _>(&node, "add_slowly", qos, move |ints, to, _| {
            defer.send((to, ints.a + ints.b))
        })?
        .timer(ms(20), move |_| match deferred.try_recv() {
            Ok((to, sum)) => to.reply(&AddTwoIntsResponse { sum }),
            Err(_) => Ok(()),
        })?;

    // Each request has a number, which comes back with its reply, and 2 s of time.
    let quick = node.client::<AddTwoInts>("add", qos, ms(2000))?;
    let slow = node.client::<AddTwoInts>("add_slowly", qos, ms(2000))?;
    let (ask_quick, ask_slow) = (quick.clone(), slow.clone());
    exec.worker("client")
        .replies(&quick, |reply, cx| tell("add", reply, cx))?
        .replies(&slow, |reply, cx| {
            tell("add_slowly", reply, cx);
            cx.stop();
        })?
        .timer(Every::once(ms(10)), move |_| {
            let number = ask_quick.call(&AddTwoIntsRequest { a: 2, b: 3 })?;
            println!("add: request {number} is 2 + 3");
            let number = ask_slow.call(&AddTwoIntsRequest { a: 20, b: 30 })?;
            println!("add_slowly: request {number} is 20 + 30");
            Ok::<_, replenish::CallError>(())
        })?;
    exec.spin()?;
    Ok(())
}

fn tell(service: &str, reply: Result<&AddTwoIntsResponse, NoReply>, cx: &CallbackContext<'_>) {
    let number = cx.request().number();
    match reply {
        Ok(reply) => println!("{service}: reply to {number} is {}", reply.sum),
        Err(why) => println!("{service}: {number}: {why}"),
    }
}
