//! Work of both pongs for a message, and its length.
#![allow(dead_code, reason = "each example needs a part")]

use rclrs::{IntoPrimitiveOptions, Node, PrimitiveOptions, RclrsError, SpinOptions};
use replenish_os::clock::thread_cpu;
use ros_env::std_msgs::msg::Int32;
use std::time::Duration;

pub(crate) const fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

/// A callback that works for `work` of CPU time and then answers.
pub(crate) fn answer(
    node: &Node,
    topic: &str,
    work: Duration,
) -> Result<impl FnMut(Int32) + Send + 'static, RclrsError> {
    let pong = node.create_publisher::<Int32>(latest(topic))?;
    Ok(move |ping: Int32| {
        let begin = thread_cpu();
        while u128::from(thread_cpu() - begin) < work.as_nanos() {}
        pong.publish(ping).ok();
    })
}

/// The latest message alone: more come than are answered.
pub(crate) fn latest(topic: &str) -> PrimitiveOptions<'_> {
    topic.keep_last(1).best_effort()
}

/// Spins for as many seconds as the first argument says, 10 without.
pub(crate) fn until() -> SpinOptions {
    let seconds = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let seconds: f64 = seconds.unwrap_or(10.0);
    SpinOptions::new().timeout(Duration::from_secs_f64(seconds.clamp(0.1, 3600.0)))
}
