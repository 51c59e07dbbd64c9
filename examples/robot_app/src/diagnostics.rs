//! The rover's answers to other programs: its health, a self-test, a drive over a distance.

use crate::rover_msgs::action::{Drive, DriveFeedback, DriveGoal, DriveResult};
use crate::rover_msgs::{msg::Health, srv::SelfTest};
use replenish::interfaces::geometry_msgs::msg::Twist;
use replenish::interfaces::std_msgs::msg::Header;
use replenish::msg::std_msgs::UInt64;
use replenish::{ActionOptions, Context, Error, Executor, Qos, RunningGoal, sleep};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Adds the node `diagnostics`, on workers without a guarantee: it runs when there is time.
///
/// # Errors
/// A name or a setting that is refused.
pub fn add(ctx: &Context, exec: &mut Executor) -> Result<(), Error> {
    let ms = Duration::from_millis;
    let node = ctx.node("diagnostics")?;
    let health = node.publisher::<Health>("health", Qos::latched())?;
    let frames = Arc::new(AtomicU64::new(0));
    let yaw_rate = Arc::new(AtomicU64::new(0)); // the bits of a number

    let (count, turn) = (frames.clone(), yaw_rate.clone());
    let (stamped, tested) = (node.clone(), frames.clone());
    exec.worker("diagnostics")
        .subscribe(&node, "frames", Qos::reliable(), move |n: &UInt64, _| {
            count.store(n.data, Relaxed);
        })?
        .subscribe(
            &node,
            "cmd_vel",
            Qos::reliable(),
            move |twist: &Twist, _| {
                turn.store(twist.angular.z.to_bits(), Relaxed);
            },
        )?
        .timer(ms(1000), move |_| {
            let stamp = stamped.now();
            let frame_id = "base_link".into();
            health.publish(&Health {
                header: Header { stamp, frame_id },
                frames: frames.load(Relaxed),
                yaw_rate: f64::from_bits(yaw_rate.load(Relaxed)),
            })
        })?
        .serve::<SelfTest, _>(&node, "self_test", Qos::services(), move |_, answer, _| {
            let seen = tested.load(Relaxed);
            answer.ok = seen > 0;
            answer.report = format!("{seen} pictures");
        })?;

    exec.worker("drive").serve_action_async(
        &node,
        "drive",
        ActionOptions::goals(1),
        |goal: &DriveGoal| (0.0..=100.0).contains(&goal.distance),
        |goal: DriveGoal, running| drive(goal.distance, running),
    )?;
    Ok(())
}

/// Ten centimetres more every 50 ms, until it is there or canceled.
async fn drive(distance: f64, running: RunningGoal<Drive>) -> Result<DriveResult, DriveResult> {
    let mut driven = 0.0;
    while driven < distance && !running.is_canceling() {
        sleep(Duration::from_millis(50)).await;
        driven = distance.min(driven + 0.1);
        let sent = running.feedback(&DriveFeedback { so_far: driven });
        sent.map_err(|_| DriveResult { driven })?;
    }
    Ok(DriveResult { driven })
}
