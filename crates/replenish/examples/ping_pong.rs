//! Ping-pong: one worker sends numbers, another sends them back after 5 ms of work each.
//!
//! Pong may burn 30 ms of CPU in every 100 ms at its priority, and goes on in the background beyond
//! that. Without real-time privilege the executor says what is not guaranteed, and runs all the
//! same.
//!
//! Run: `cargo run --release -p replenish --example ping_pong` in one process; with the address of
//! an agent (`cargo run --release -- agent` is one: `127.0.0.1:8888`) behind it, through that
//! agent.

use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Error, Executor, Qos};
use std::time::{Duration, Instant};

fn main() -> Result<(), Error> {
    let ms = Duration::from_millis;
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let node = ctx.node("ping_pong")?;
    let ping = node.publisher::<Int32>("ping", Qos::best_effort())?;
    let pong = node.publisher::<Int32>("pong", Qos::best_effort())?;

    let mut exec = Executor::new(&ctx);
    exec.worker("pong")
        .budget(Budget::of(ms(30)).every(ms(100)))
        .cpu(0)
        .subscribe(&node, "ping", Qos::best_effort(), move |ping: &Int32, _| {
            let start = Instant::now();
            while start.elapsed() < ms(5) {} // what a control algorithm would need
            pong.publish(ping)
        })?;
    let mut n = 0;
    exec.worker("ping")
        .timer(ms(10), move |_| {
            n += 1;
            ping.publish(&Int32 { data: n })
        })?
        .subscribe(&node, "pong", Qos::best_effort(), |pong: &Int32, cx| {
            if pong.data >= 100 {
                println!("answered: {}", pong.data);
                cx.stop();
            }
        })?;
    println!("{}", exec.spin()?); // every thread and every handle, in numbers
    Ok(())
}
