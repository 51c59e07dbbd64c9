//! The rover of ../src for rclrs 0.8: the same topics, parameters, service and action, without the
//! guarantee and the budget, and without the managed node, which rclrs does not have: `control` is
//! always active. Not built in CI: see README.md.

use rclrs::*;
use ros_env::{
    geometry_msgs::msg::Twist,
    rover_msgs::{
        action::{Drive, Drive_Feedback, Drive_Result},
        msg::Health,
        srv::{SelfTest, SelfTest_Request, SelfTest_Response},
    },
    sensor_msgs::msg::{Image, Imu},
    std_msgs::msg::UInt64,
};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::Arc;
use std::time::Duration;

fn main() -> Result<(), RclrsError> {
    let mut executor = Context::default_from_env()?.create_basic_executor();
    let _sensors = sensors(&executor)?;
    let _control = control(&executor)?;
    let _camera = camera(&executor)?;
    let _diagnostics = diagnostics(&executor)?;
    executor.spin(SpinOptions::default()).first_error()
}

fn sensors(executor: &Executor) -> Result<(Timer, Timer), RclrsError> {
    let node = executor.create_node("sensors")?;
    let gyroscope = node.create_publisher::<Imu>("imu".sensor_data_qos())?;
    let camera = node.create_publisher::<Image>("image".sensor_data_qos())?;
    let (clock, mut imu) = (node.clone(), Imu::default());
    let mut image = Image {
        height: 48,
        width: 64,
        step: 64,
        encoding: "mono8".into(),
        data: (0..64 * 48).map(|i: u32| i.to_le_bytes()[0]).collect(),
        ..Image::default()
    };
    let fast = node.create_timer_repeating(Duration::from_millis(10), move || {
        imu.header.stamp = stamp(&clock);
        imu.angular_velocity.z = 0.2;
        gyroscope.publish(&imu).ok();
    })?;
    let clock = node.clone();
    let slow = node.create_timer_repeating(Duration::from_millis(100), move || {
        image.header.stamp = stamp(&clock);
        camera.publish(&image).ok();
    })?;
    Ok((fast, slow))
}

fn stamp(node: &Node) -> ros_env::builtin_interfaces::msg::Time {
    node.get_clock().now().to_ros_msg().unwrap_or_default()
}

fn control(executor: &Executor) -> Result<Subscription<Imu>, RclrsError> {
    let node = executor.create_node("control")?;
    let gain = node
        .declare_parameter("gain")
        .default(0.5)
        .range(ParameterRange {
            lower: Some(0.0),
            upper: Some(2.0),
            step: None,
        })
        .description("of the yaw rate")
        .mandatory()
        .expect("a declaration that is right");
    let command = node.create_publisher::<Twist>("cmd_vel")?;
    node.create_subscription("imu".sensor_data_qos(), move |imu: Imu| {
        let mut twist = Twist::default();
        twist.angular.z = -gain.get() * imu.angular_velocity.z;
        command.publish(twist).ok();
    })
}

fn camera(executor: &Executor) -> Result<WorkerSubscription<Image, u64>, RclrsError> {
    let node = executor.create_node("camera")?;
    let frames = node.create_publisher::<UInt64>("frames")?;
    let worker = node.create_worker::<u64>(0);
    worker.create_subscription(
        "image".sensor_data_qos(),
        move |seen: &mut u64, image: Image| {
            let edges: u64 = (0..500).map(|_| edges(&image.data)).sum();
            *seen += u64::from(std::hint::black_box(edges) < u64::MAX);
            frames.publish(UInt64 { data: *seen }).ok();
        },
    )
}

/// Number of neighbours that differ by more than 16 grey levels.
fn edges(pixels: &[u8]) -> u64 {
    let differ = |(a, b): (&u8, &u8)| u64::from(a.abs_diff(*b) > 16);
    let pixels = std::hint::black_box(pixels);
    pixels.iter().zip(pixels.iter().skip(1)).map(differ).sum()
}

/// The ends that must live as long as the program spins.
type Ends = (
    Subscription<UInt64>,
    Subscription<Twist>,
    Timer,
    Service<SelfTest>,
    ActionServer<Drive>,
);

fn diagnostics(executor: &Executor) -> Result<Ends, RclrsError> {
    let node = executor.create_node("diagnostics")?;
    let latched = "health".keep_last(1).transient_local();
    let health = node.create_publisher::<Health>(latched)?;
    let seen = Arc::new(AtomicU64::new(0));
    let yaw_rate = Arc::new(AtomicU64::new(0)); // the bits of a number

    let count = seen.clone();
    let frames = node.create_subscription("frames", move |n: UInt64| {
        count.store(n.data, Relaxed);
    })?;
    let turn = yaw_rate.clone();
    let commands = node.create_subscription("cmd_vel", move |twist: Twist| {
        turn.store(twist.angular.z.to_bits(), Relaxed);
    })?;
    let (clock, looked) = (node.clone(), seen.clone());
    let second = node.create_timer_repeating(Duration::from_secs(1), move || {
        let mut message = Health::default();
        message.header.stamp = stamp(&clock);
        message.header.frame_id = "base_link".into();
        message.frames = looked.load(Relaxed);
        message.yaw_rate = f64::from_bits(yaw_rate.load(Relaxed));
        health.publish(message).ok();
    })?;
    let self_test = node.create_service("self_test", move |_: SelfTest_Request| {
        let seen = seen.load(Relaxed);
        SelfTest_Response {
            ok: seen > 0,
            report: format!("{seen} pictures"),
        }
    })?;
    let clock = node.clone();
    let drive = node.create_action_server("drive", move |goal| drive(clock.clone(), goal))?;
    Ok((frames, commands, second, self_test, drive))
}

/// Ten centimetres more every 50 ms, until it is there or canceled.
async fn drive(node: Node, requested: RequestedGoal<Drive>) -> TerminatedGoal {
    let distance = requested.goal().distance;
    if !(0.0..=100.0).contains(&distance) {
        return requested.reject();
    }
    let goal = requested.accept().execute();
    let mut driven = 0.0;
    while driven < distance {
        if goal.unless_cancel_requested(pause(&node)).await.is_err() {
            return goal.begin_cancelling().cancelled_with(Drive_Result { driven });
        }
        driven = distance.min(driven + 0.1);
        goal.publish_feedback(Drive_Feedback { so_far: driven });
    }
    goal.succeeded_with(Drive_Result { driven })
}

/// 50 ms: a timer that ends a future, since rclrs brings no sleep.
async fn pause(node: &Node) {
    let (done, ended) = futures::channel::oneshot::channel();
    let timer = node.create_timer_oneshot(Duration::from_millis(50), move || {
        done.send(()).ok();
    });
    ended.await.ok();
    drop(timer);
}
