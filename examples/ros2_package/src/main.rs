//! A node that says that it is alive, with a budget: `ros2 run heartbeat heartbeat`.

use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Descriptor, Error, Executor, ParameterOptions, Qos};
use std::time::Duration;

fn main() -> Result<(), Error> {
    let ms = Duration::from_millis;
    let ctx = Context::from_args()?; // --ros-args; the launch file says how it reaches ROS 2
    let node = ctx.node("heartbeat")?;
    let parameters = node.parameters(ParameterOptions::new())?;
    let rate = Descriptor::new().integer_range(1, 10_000, 1);
    parameters.declare("period_ms", 1000, rate)?;
    let period = ms(parameters.get::<i64>("period_ms")?.unsigned_abs());

    let alive = node.publisher::<Int32>("alive", Qos::reliable())?;
    println!("{} beats on {}", node.name(), alive.topic());
    let mut exec = Executor::new(&ctx);
    let mut beats = Int32::default();
    exec.worker("beat")
        .budget(Budget::of(ms(1)).every(ms(20)))
        .timer(period, move |_| {
            beats.data = beats.data.wrapping_add(1);
            alive.publish(&beats)
        })?;
    exec.worker("service").parameters(&parameters)?;
    println!("{}", exec.spin()?);
    Ok(())
}
