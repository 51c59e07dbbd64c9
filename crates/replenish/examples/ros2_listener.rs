//! Listens to ROS 2 without an agent: Int32 on `/chatter`, on a thread with a budget of its own.
//!
//! Run: `cargo run -p replenish --example ros2_listener`; a number behind it ends it after as many.

use replenish::{Budget, Context, Error, Executor, Qos, msg::std_msgs::Int32};
use std::time::Duration;

fn main() -> Result<(), Error> {
    let most = std::env::args().nth(1).and_then(|n| n.parse().ok());
    let node = Context::ros2()?.node("replenish_listener")?;
    let (mut exec, ms, mut heard) = (Executor::new(node.context()), Duration::from_millis, 0);
    exec.worker("listen")
        .budget(Budget::of(ms(10)).every(ms(100)))
        .subscribe(
            &node,
            "chatter",
            Qos::reliable(),
            move |chatter: &Int32, cx| {
                println!("I heard: {}", chatter.data);
                heard += 1;
                if Some(heard) == most {
                    cx.stop();
                }
            },
        )?;
    exec.spin().map(drop)
}
