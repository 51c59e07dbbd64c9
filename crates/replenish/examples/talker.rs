//! A talker and a listener as one ROS 2 program: names and parameters from the command line, and
//! Ctrl-C ends it with a report.
//!
//! Run: `REPLENISH_AGENT=in-process cargo run -p replenish --example talker -- --ros-args
//! -r chatter:=/news -p period_ms:=100`; with `REPLENISH_AGENT=ros2` it talks with ROS 2 itself,
//! and without the variable through the agent at `127.0.0.1:8888`.

use replenish::interfaces::std_msgs::msg::String;
use replenish::{Context, Descriptor, Error, Executor, ParameterOptions, Qos};
use std::time::Duration;

fn main() -> Result<(), Error> {
    let ctx = Context::from_args()?;
    let node = ctx.node("talker")?;
    let parameters = node.parameters(ParameterOptions::new())?;
    parameters.declare(
        "period_ms",
        500,
        Descriptor::new().integer_range(1, 10_000, 1),
    )?;
    let period = parameters.get::<i64>("period_ms")?.unsigned_abs();

    let out = node.publisher::<String>("chatter", Qos::reliable())?;
    println!("{} talks on {}", node.name(), out.topic());
    let mut exec = Executor::new(&ctx);
    let (mut n, mut message) = (0, String::default());
    exec.worker("talk")
        .timer(Duration::from_millis(period), move |_| {
            n += 1;
            write(&mut message, n);
            out.publish(&message)
        })?;
    exec.worker("listen")
        .subscribe(&node, "chatter", Qos::reliable(), |heard: &String, _| {
            println!("heard {}", heard.data);
        })?
        .parameters(&parameters)?;
    println!("{}", exec.spin()?);
    Ok(())
}

/// Into memory that is there from the last time.
fn write(message: &mut String, n: u32) {
    use std::fmt::Write;
    message.data.clear();
    write!(message.data, "Hello World: {n}").ok();
}
