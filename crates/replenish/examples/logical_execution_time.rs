//! Logical Execution Time: all callbacks of a round see the world as it was when the round began,
//! and what they publish goes out when it has ended.
//!
//! `control` answers each reading with a command. `monitor` runs behind it in the same round and
//! yet sees the command of the round before, every time and however fast the messages are: its
//! input was taken at the start. Without the semantics it would depend on who is faster.
//!
//! Run: `cargo run -p replenish --example logical_execution_time` in one process; with an agent's
//! address (`127.0.0.1:8888`) behind it, through that agent.

use replenish::msg::std_msgs::Int32;
use replenish::{Context, Executor, Qos, Semantics, Trigger};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let node = ctx.node("robot")?;
    let qos = Qos::reliable();
    let reading = node.publisher::<Int32>("reading", qos)?;
    let command = node.publisher::<Int32>("command", qos)?;

    let mut exec = Executor::new(&ctx);
    exec.worker("loop")
        .semantics(Semantics::LogicalExecutionTime)
        .trigger(Trigger::All) // a round begins when both inputs are there
        .output_barrier(1, 64) // one message of up to 64 bytes per round
        .subscribe(&node, "reading", qos, {
            let command = command.clone();
            move |reading: &Int32, cx| {
                println!("control: reading {}", reading.data);
                let answer = Int32 { data: reading.data };
                cx.publish(&command, &answer) // behind the barrier
            }
        })?
        .subscribe(&node, "command", qos, |command: &Int32, cx| {
            println!("monitor: command {}", command.data);
            if command.data == 5 {
                cx.stop();
            }
        })?;
    let mut n = 0;
    exec.worker("sensor")
        .timer(Duration::from_millis(10), move |_| {
            n += 1;
            reading.publish(&Int32 { data: n })
        })?;
    command.publish(&Int32 { data: 0 })?; // what the first round sees
    exec.spin()?;
    Ok(())
}
