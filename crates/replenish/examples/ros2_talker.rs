//! Talks to ROS 2 without an agent: Int32 on `/chatter`, ten a second. `ros2 topic echo /chatter`.
//!
//! Run: `cargo run -p replenish --example ros2_talker`; a number behind it ends it after as many.

use replenish::{Context, Error, Executor, Qos, msg::std_msgs::Int32};
use std::time::Duration;

fn main() -> Result<(), Error> {
    let most = std::env::args().nth(1).and_then(|n| n.parse().ok());
    let node = Context::ros2()?.node("replenish_talker")?;
    let chatter = node.publisher::<Int32>("chatter", Qos::reliable())?;
    let (mut exec, mut data) = (Executor::new(node.context()), 0);
    exec.worker("talk")
        .timer(Duration::from_millis(100), move |cx| {
            if Some(data) == most {
                cx.stop();
                return Ok(());
            }
            data += 1;
            chatter.publish(&Int32 { data })
        })?;
    println!("{}", exec.spin()?);
    Ok(())
}
