//! Ping-pong in one process: pong may burn 30 ms of CPU in every 100 ms at its priority, and goes
//! on in the background beyond that. Runs anywhere; without real-time privilege it says what is
//! not guaranteed.
//!
//! `cargo run --release -p replenish --example ping_pong`

use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Executor, Qos};
use std::time::{Duration, Instant};

fn main() -> Result<(), replenish::Error> {
    let ctx = Context::in_process();
    let node = ctx.node("example")?;
    let ping = node.publisher::<Int32>("ping", Qos::best_effort())?;
    let pong = node.publisher::<Int32>("pong", Qos::best_effort())?;
    let ms = Duration::from_millis;

    let mut exec = Executor::new(&ctx);
    exec.worker("pong")
        .budget(Budget::of(ms(30)).every(ms(100)))
        .cpu(0)
        .subscribe(&node, "ping", Qos::best_effort(), move |ping: &Int32, _| {
            let start = Instant::now();
            while start.elapsed() < ms(5) {}
            pong.publish(ping)
        })?;
    let mut n = 0;
    exec.worker("ping")
        .timer(ms(10), move |_| {
            n += 1;
            ping.publish(&Int32 { data: n })
        })?
        .subscribe(&node, "pong", Qos::best_effort(), |pong: &Int32, cx| {
            if pong.data == 100 {
                cx.stop();
            }
        })?;
    println!("{}", exec.spin()?);
    Ok(())
}
