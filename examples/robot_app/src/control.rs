//! The control loop: turns against what the gyroscope says, within 5 ms, a hundred times a second.

use replenish::interfaces::geometry_msgs::msg::Twist;
use replenish::interfaces::sensor_msgs::msg::Imu;
use replenish::{
    Context, Descriptor, Error, Executor, Guarantee, ParameterOptions, Qos, Transition,
};
use std::time::Duration;

/// Adds the node `control`: managed, with parameters `gain` and `autostart`.
///
/// # Errors
/// A name or a setting that is refused.
pub fn add(ctx: &Context, exec: &mut Executor) -> Result<(), Error> {
    let ms = Duration::from_millis;
    let node = ctx.node("control")?;
    let parameters = node.parameters(ParameterOptions::new())?;
    let gain = Descriptor::new().double_range(0.0, 2.0, 0.0);
    parameters.declare("gain", 0.5, gain.description("of the yaw rate"))?;
    parameters.declare("autostart", true, Descriptor::new().read_only())?;

    let lifecycle = node.lifecycle()?;
    let command = lifecycle.publisher::<Twist>("cmd_vel", Qos::reliable())?;
    if parameters.get::<bool>("autostart")? {
        lifecycle.change(Transition::Configure)?;
        lifecycle.change(Transition::Activate)?;
    }

    let read = parameters.clone();
    exec.worker("control")
        .guarantee(Guarantee::at(100.0).taking(ms(1)).deadline(ms(5)))
        .subscribe(&node, "imu", Qos::sensor_data(), move |imu: &Imu, _| {
            let mut twist = Twist::default();
            twist.angular.z = -read.get::<f64>("gain")? * imu.angular_velocity.z;
            command.publish(&twist)?; // nothing leaves while the node is not active
            Ok::<_, Error>(())
        })?;
    exec.worker("control_services")
        .parameters(&parameters)?
        .lifecycle(&lifecycle)?;
    Ok(())
}
