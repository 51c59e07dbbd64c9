//! A managed node: a camera that another node configures, activates, deactivates and shuts down.
//! It publishes while it is active and is silent otherwise.
//!
//! Run: `cargo run -p replenish --example lifecycle` in one process; with an agent's address
//! (`127.0.0.1:8888`) behind it, through that agent.

use replenish::msg::std_msgs::Int32;
use replenish::{Context, Executor, Outcome, Qos, Transition};
use replenish_interfaces::lifecycle_msgs::msg::{Transition as Asked, TransitionEvent};
use replenish_interfaces::lifecycle_msgs::srv::{ChangeState, ChangeStateRequest};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ms = Duration::from_millis;
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let node = ctx.node("camera")?;
    let mut exec = Executor::new(&ctx);

    // The work of a transition; the first attempt to configure fails and changes nothing.
    let lifecycle = node.lifecycle()?;
    let mut attempts = 0;
    lifecycle.on_transition(Transition::Configure, move |_| {
        attempts += 1;
        println!("camera: attempt {attempts}");
        [Outcome::Failure, Outcome::Success][usize::from(attempts > 1)]
    });
    let pictures = lifecycle.publisher::<Int32>("pictures", Qos::reliable())?;
    let mut n = 0;
    exec.worker("camera").lifecycle(&lifecycle)?;
    exec.worker("sensor").timer(ms(5), move |_| {
        n += 1;
        pictures.publish(&Int32 { data: n }).map(drop)
    })?;

    // Another node, which knows the standard service and the standard event only.
    let (other, qos) = (ctx.node("manager")?, Qos::services());
    let client = other.client::<ChangeState>("camera/change_state", qos, ms(5000))?;
    let asks = client.clone();
    let mut plan = [
        "configure",
        "configure",
        "activate",
        "deactivate",
        "shutdown",
    ]
    .into_iter();
    let mut seen = 0;
    exec.worker("manager")
        .subscribe(
            &other,
            "camera/transition_event",
            qos,
            |event: &TransitionEvent, cx| {
                println!("state: {}", event.goal_state.label);
                if event.goal_state.label == "finalized" {
                    cx.stop();
                }
            },
        )?
        .subscribe(&other, "pictures", qos, move |_: &Int32, _| {
            seen += 1;
            if seen == 1 {
                println!("manager: the first picture");
            }
        })?
        .replies(&client, |reply, _| {
            println!("reply: {}", reply.is_ok_and(|r| r.success));
        })?
        .timer(ms(60), move |_| {
            let label = plan.next().unwrap_or("shutdown").into();
            let transition = Asked { id: 0, label };
            asks.call(&ChangeStateRequest { transition }).map(drop)
        })?;
    exec.spin()?;
    Ok(())
}
