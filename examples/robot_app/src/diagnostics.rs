//! The rover's answers to other programs: its health, a self-test, a drive over a distance.

use crate::rover_msgs::action::{Drive, DriveFeedback, DriveGoal, DriveResult};
use crate::rover_msgs::{msg::Health, srv::SelfTest};
use replenish::msg::std_msgs::UInt64;
use replenish::{ActionOptions, Context, Error, Executor, GoalHandle, Qos};
use replenish_interfaces::geometry_msgs::msg::Twist;
use replenish_interfaces::std_msgs::msg::Header;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
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

    // Goals that were accepted come to the timer, which drives each of them a little further.
    let (begin, begun) = mpsc::channel();
    let mut goals = Vec::new();
    exec.worker("drive")
        .serve_action::<Drive, _, _, _>(
            &node,
            "drive",
            ActionOptions::goals(1),
            move |goal: &DriveGoal, new, _| match goal.distance {
                metres @ 0.0..=100.0 => begin.send((new.accept()?, metres, 0.0)).or(Ok(())),
                _ => new.reject(),
            },
            |_, _| true,
        )?
        .timer(ms(50), move |_| {
            goals.extend(begun.try_iter());
            goals.retain_mut(|(goal, distance, driven)| drive(goal, *distance, driven));
        })?;
    Ok(())
}

/// Ten centimetres more; whether the goal goes on.
fn drive(goal: &GoalHandle<Drive>, distance: f64, driven: &mut f64) -> bool {
    let arrived = *driven >= distance;
    if !arrived && !goal.is_canceling() {
        *driven = distance.min(*driven + 0.1);
        return goal.feedback(&DriveFeedback { so_far: *driven }).is_ok();
    }
    let result = DriveResult { driven: *driven };
    let ended = if arrived {
        goal.succeed(&result)
    } else {
        goal.canceled(&result)
    };
    ended.ok(); // an answer that cannot leave now is sent again by the executor
    false
}
