//! Sensors that a robot would have: a gyroscope at 100 Hz, a camera with 64 by 48 pixels at 10 Hz.

use replenish::interfaces::sensor_msgs::msg::{Image, Imu};
use replenish::{Context, Error, Executor, Qos};
use std::time::Duration;

/// Adds the node `sensors`, which makes them up.
///
/// # Errors
/// A name or a setting that is refused.
pub fn simulate(ctx: &Context, exec: &mut Executor) -> Result<(), Error> {
    let ms = Duration::from_millis;
    let node = ctx.node("sensors")?;
    let gyroscope = node.publisher::<Imu>("imu", Qos::sensor_data())?;
    let camera = node.publisher::<Image>("image", Qos::sensor_data())?;

    let (clock, mut imu) = (node.clone(), Imu::default());
    let mut image = Image {
        height: 48,
        width: 64,
        step: 64,
        ..Image::default()
    };
    image.encoding = "mono8".into();
    image.data = (0..64 * 48).map(|i: u32| i.to_le_bytes()[0]).collect();
    exec.worker("gyroscope").timer(ms(10), move |_| {
        imu.header.stamp = clock.now();
        imu.angular_velocity.z = 0.2;
        gyroscope.publish(&imu)
    })?;
    exec.worker("pictures").timer(ms(100), move |_| {
        image.header.stamp = node.now();
        camera.publish(&image)
    })?;
    Ok(())
}
