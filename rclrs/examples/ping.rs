//! Sends a message to each of two topics every 10 ms, and counts the answers.
//!
//!     ping SECONDS

mod load;

use load::{latest, ms, until};
use rclrs::*;
use ros_env::std_msgs::msg::Int32;
use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let context = Context::default();
    let mut executor = context.create_basic_executor();
    let node = executor.create_node("ping")?;
    let counts = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
    let mut kept = Vec::new();
    let mut publishers = Vec::new();
    for (name, count) in ["high", "low"].iter().zip(&counts) {
        let count = Arc::clone(count);
        let answers = format!("{name}_pong");
        let counts = move |_: Int32| {
            count.fetch_add(1, Relaxed);
        };
        kept.push(node.create_subscription(latest(&answers), counts)?);
        publishers.push(node.create_publisher::<Int32>(latest(name))?);
    }
    let sent = Arc::new(AtomicU64::new(0));
    let begin = Instant::now();
    let all = Arc::clone(&sent);
    let _timer = node.create_timer_repeating(ms(10), move || {
        let data = i32::try_from(all.fetch_add(1, Relaxed)).unwrap_or(i32::MAX);
        for publisher in &publishers {
            publisher.publish(Int32 { data }).ok();
        }
    })?;
    executor.spin(until()).timeout_ok().first_error()?;
    let [high, low] = counts.map(|count| count.load(Relaxed));
    let (sent, elapsed) = (sent.load(Relaxed), begin.elapsed().as_nanos());
    println!("high {high} low {low} sent {sent} elapsed_ns {elapsed}");
    Ok(())
}
