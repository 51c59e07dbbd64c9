//! The camera: looks for edges in each picture, and would take all the CPU time there is.

use replenish::interfaces::sensor_msgs::msg::Image;
use replenish::msg::std_msgs::UInt64;
use replenish::{Budget, Context, Error, Executor, Qos};
use std::time::Duration;

/// Adds the node `camera`: 30 ms of CPU time in every 100 ms, and not more.
///
/// # Errors
/// A name or a setting that is refused.
pub fn add(ctx: &Context, exec: &mut Executor) -> Result<(), Error> {
    let ms = Duration::from_millis;
    let node = ctx.node("camera")?;
    let frames = node.publisher::<UInt64>("frames", Qos::reliable())?;
    let mut seen = 0;
    exec.worker("camera")
        .budget(Budget::of(ms(30)).every(ms(100)))
        .subscribe(
            &node,
            "image",
            Qos::sensor_data(),
            move |image: &Image, _| {
                let edges: u64 = (0..500).map(|_| edges(&image.data)).sum();
                seen += u64::from(std::hint::black_box(edges) < u64::MAX);
                frames.publish(&UInt64 { data: seen })
            },
        )?;
    Ok(())
}

/// Number of neighbours that differ by more than 16 grey levels.
fn edges(pixels: &[u8]) -> u64 {
    let differ = |(a, b): (&u8, &u8)| u64::from(a.abs_diff(*b) > 16);
    let pixels = std::hint::black_box(pixels);
    pixels.iter().zip(pixels.iter().skip(1)).map(differ).sum()
}
