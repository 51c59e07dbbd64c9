//! Triggers: what must be there for a worker to begin a round.
//!
//! `fusion` waits until a picture *and* a reading are there; readings come three times as often,
//! and of those only the newest counts. `watch` begins a round for every tenth reading, as a
//! function of its own says. Input that waits for the rest costs nothing: no worker ever looks in a
//! loop.
//!
//! Run: `cargo run -p replenish --example trigger` in one process; with an agent's address
//! (`127.0.0.1:8888`) behind it, through that agent.

use replenish::msg::std_msgs::Int32;
use replenish::{CallbackContext, Context, Error, Executor, PublishError, Publisher, Qos, Trigger};
use std::time::Duration;

fn main() -> Result<(), Error> {
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let node = ctx.node("robot")?;
    let pictures = node.publisher::<Int32>("pictures", Qos::reliable())?;
    let readings = node.publisher::<Int32>("readings", Qos::reliable())?;
    let newest = Qos::reliable().keep_last(1);

    let mut exec = Executor::new(&ctx);
    exec.worker("fusion")
        .trigger(Trigger::All)
        .subscribe(&node, "readings", newest, |reading: &Int32, _| {
            println!("fusion: reading {}", reading.data);
        })?
        .subscribe(&node, "pictures", Qos::reliable(), |picture: &Int32, cx| {
            println!("fusion: picture {}", picture.data);
            if picture.data == 5 {
                cx.stop();
            }
        })?;
    let mut seen = 0;
    exec.worker("watch")
        .trigger(Trigger::custom(move |_| {
            seen += 1; // called when something new has come
            seen % 10 == 0
        }))
        .subscribe(&node, "readings", newest, |reading: &Int32, _| {
            println!("watch: reading {}", reading.data);
        })?;
    exec.worker("sensors")
        .timer(Duration::from_millis(30), counter(pictures))?
        .timer(Duration::from_millis(10), counter(readings))?;
    exec.spin()?;
    Ok(())
}

/// Publishes 1, 2, 3, …
fn counter(
    out: Publisher<Int32>,
) -> impl FnMut(&CallbackContext<'_>) -> Result<(), PublishError> + Send {
    let mut n = 0;
    move |_| {
        n += 1;
        out.publish(&Int32 { data: n })
    }
}
