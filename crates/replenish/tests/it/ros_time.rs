//! Time as ROS has it: the wall clock, or `/clock` for nodes with `use_sim_time`, backwards, too.

use crate::common::{eventually, executor, settles};
use replenish::args::{Environment, RosArgs};
use replenish::middleware::InProcessBus;
use replenish::msg::builtin_interfaces::Time;
use replenish::{Context, Every, Node, Overrun, Publisher, Qos};
use replenish_interfaces::rosgraph_msgs::msg::Clock;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const MS: Duration = Duration::from_millis(1);
const SECOND: Duration = Duration::from_secs(1);
const LIMIT: Duration = Duration::from_secs(60);

/// A context with these arguments, and a simulator in another one.
struct World {
    ctx: Context,
    clock: Publisher<Clock>,
}

impl World {
    fn new(line: &str) -> Self {
        let bus = InProcessBus::new();
        let simulator = Context::new(bus.participant()).node("simulator").unwrap();
        let args = ["program"].into_iter().chain(line.split_whitespace());
        let args = RosArgs::parse(args.map(String::from), &Environment::default()).unwrap();
        Self {
            ctx: Context::new(bus.participant()).with_args(args),
            clock: simulator.publisher("/clock", Qos::clock()).unwrap(),
        }
    }

    /// Says the time, and waits until `node` has it.
    fn tell(&self, node: &Node, millis: u64) {
        let clock = time(millis);
        self.clock.publish(&Clock { clock }).unwrap();
        assert!(eventually(|| node.now() == clock), "{:?}", node.now());
    }
}

fn time(millis: u64) -> Time {
    Time {
        sec: i32::try_from(millis / 1000).unwrap(),
        nanosec: u32::try_from(millis % 1000).unwrap() * 1_000_000,
    }
}

fn counter() -> (Arc<AtomicU64>, impl Fn() -> u64) {
    let count = Arc::new(AtomicU64::new(0));
    let read = Arc::clone(&count);
    (count, move || read.load(Ordering::SeqCst))
}

#[test]
fn timers_and_stamps_follow_the_clock_of_a_simulation() {
    let world = World::new("--ros-args -p use_sim_time:=true");
    let node = world.ctx.node("n").unwrap();
    assert!(node.uses_sim_time());
    assert_eq!(node.now(), time(0), "before the first message");
    let (mut exec, _) = executor(&world.ctx);
    let ((ticks, ticked), (steady, steadily), (once, fired)) = (counter(), counter(), counter());
    exec.worker("w")
        .ros_timer(&node, SECOND, move |_| {
            ticks.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap()
        .ros_timer(&node, Every::once(2 * SECOND), move |_| {
            once.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap()
        .timer(MS, move |_| {
            steady.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| steadily() > 3), "steady time needs no clock");
    world.tell(&node, 100_000);
    world.tell(&node, 100_900);
    assert_eq!(ticked(), 0);
    world.tell(&node, 101_000);
    assert!(eventually(|| ticked() == 1));
    world.tell(&node, 105_500); // four releases count as one
    assert!(eventually(|| (ticked(), fired()) == (2, 1)));
    world.tell(&node, 50_000); // backwards: the timers start over
    world.tell(&node, 50_999);
    assert_eq!((ticked(), fired()), (2, 1));
    world.tell(&node, 51_000);
    assert!(eventually(|| ticked() == 3));
    world.tell(&node, 52_250);
    assert!(eventually(|| (ticked(), fired()) == (4, 2)));
    // It stands still, and so do they.
    let steps = steadily();
    assert!(eventually(|| steadily() > steps + 20));
    assert_eq!((ticked(), node.now()), (4, time(52_250)));
    let report = running.stop();
    let clocks = report.handles.iter().filter(|h| h.id == "/n/sub:/clock");
    assert_eq!(clocks.count(), 1);
}

#[test]
fn a_node_without_it_goes_by_the_wall_clock() {
    let world = World::new("--ros-args -p simulated:use_sim_time:=true");
    let plain = world.ctx.node("plain").unwrap();
    let simulated = world.ctx.node("simulated").unwrap();
    assert!(simulated.uses_sim_time() && !plain.uses_sim_time());
    let (mut exec, _) = executor(&world.ctx);
    let (ticks, ticked) = counter();
    exec.worker("w")
        .ros_timer(&plain, MS, move |_| {
            ticks.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let _running = exec.start().unwrap();
    world.tell(&simulated, 7000);
    assert!(eventually(|| ticked() > 3));
    let since = |t: SystemTime| t.duration_since(UNIX_EPOCH).unwrap();
    let before = since(SystemTime::now());
    let now = plain.now();
    let now = Duration::new(now.sec.try_into().unwrap(), now.nanosec);
    assert!(before <= now && now <= since(SystemTime::now()));
}

#[test]
fn an_executor_without_threads_follows_the_clock() {
    let world = World::new("--ros-args -p use_sim_time:=true -r /clock:=/sim/clock");
    let moved = world.ctx.node("n").unwrap();
    let (mut exec, _) = executor(&world.ctx);
    let (ticks, ticked) = counter();
    exec.worker("w")
        .ros_timer(&moved, SECOND, move |_| {
            ticks.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let other = world.ctx.node("teller").unwrap();
    // It is a topic like others: it has another name here.
    let clock = other.publisher::<Clock>("/clock", Qos::clock()).unwrap();
    assert_eq!(clock.topic(), "/sim/clock");
    for (millis, expected) in [(1000, 0), (2000, 1), (2500, 1), (3000, 2)] {
        let message = Clock {
            clock: time(millis),
        };
        clock.publish(&message).unwrap();
        let state = || (moved.now(), ticked());
        local.spin_while(LIMIT, || state() != (time(millis), expected));
        local.spin_for(20 * MS); // and no more of it
        assert_eq!(state(), (time(millis), expected));
    }
}

#[test]
fn rates_wait_for_the_next_beat() {
    let world = World::new("--ros-args -p simulated:use_sim_time:=true");
    let plain = world.ctx.node("plain").unwrap();
    let mut rate = plain.rate(2.0).unwrap();
    let start = Instant::now();
    assert!(rate.sleep());
    assert!(start.elapsed() >= 490 * MS);
    std::thread::sleep(1050 * MS); // a loaded machine reaches the beat after these all the same
    assert!(!rate.sleep(), "the beat is over");
    assert!(rate.sleep(), "the grid is kept");

    let node = world.ctx.node("simulated").unwrap();
    let _running = executor(&world.ctx).0.start().unwrap();
    world.tell(&node, 10_000);
    let mut rate = node.rate(1.0).unwrap();
    let (beats, beaten) = counter();
    let thread = std::thread::spawn(move || {
        for _ in 0..2 {
            rate.sleep(); // the beat is over for a thread that a busy machine starts late
            beats.fetch_add(1, Ordering::SeqCst);
        }
    });
    world.tell(&node, 10_999);
    assert_eq!(beaten(), 0);
    world.tell(&node, 11_000);
    assert!(eventually(|| beaten() == 1));
    world.tell(&node, 3000); // backwards: a period from there
    world.tell(&node, 3999);
    assert_eq!(beaten(), 1);
    // A period later; the thread may not have looked before now, and begins where it looks.
    assert!((4..60).any(|second| {
        world.tell(&node, second * 1000 + 999);
        settles(&beaten) && beaten() == 2
    }));
    thread.join().unwrap();
}

#[test]
fn what_cannot_be_is_refused() {
    let world = World::new("--ros-args -p use_sim_time:=true");
    let node = world.ctx.node("n").unwrap();
    let says = |every: Every| {
        let (mut exec, _) = executor(&world.ctx);
        let added = exec.worker("w").ros_timer(&node, every, |_| ());
        added.err().unwrap().to_string()
    };
    let set = "timer of node /n: every = set is not allowed: \
               a started timer that skips: its node follows /clock";
    assert_eq!(says(Every::period(SECOND).not_started()), set);
    assert_eq!(says(Every::period(SECOND).overrun(Overrun::Delay)), set);
    assert_eq!(
        says(Every::period(Duration::ZERO)),
        "timer of node /n: period = 0 is not allowed: 1 ns or more"
    );
    for hertz in [0.0, -1.0, f64::NAN, 1e12] {
        let error = node.rate(hertz).unwrap_err().to_string();
        let start = format!("node /n: rate = {hertz} is not allowed: above 0 Hz to 1 GHz");
        assert_eq!(error, start);
    }
}

/// A sleep begins with the first message, ends at its time, and starts over when time jumps back.
#[test]
fn sleeps_follow_the_clock_of_a_simulation() {
    let world = World::new("--ros-args -p use_sim_time:=true");
    let node = world.ctx.node("n").unwrap();
    let (mut exec, _) = executor(&world.ctx);
    let (count, woken) = counter();
    let (sleeper, wakes) = (node.clone(), Arc::clone(&count));
    exec.worker("w")
        .task(async move {
            loop {
                sleeper.sleep(SECOND).await;
                wakes.fetch_add(1, Ordering::SeqCst);
            }
        })
        .unwrap();
    // More than have a place: they look by themselves.
    let mut many = exec.worker("many");
    for _ in 0..70 {
        let (sleeper, wakes) = (node.clone(), Arc::clone(&count));
        let one = async move {
            sleeper.sleep(1000 * SECOND).await;
            wakes.fetch_add(100, Ordering::SeqCst);
        };
        many = many.task(one).unwrap();
    }
    let running = exec.start().unwrap();
    assert!(settles(&woken) && woken() == 0);
    world.tell(&node, 100_000);
    assert!(settles(&woken) && woken() == 0);
    world.tell(&node, 101_000);
    assert!(eventually(|| woken() == 1));
    world.tell(&node, 101_900);
    assert!(settles(&woken) && woken() == 1);
    world.tell(&node, 50_000); // starts over
    assert!(settles(&woken) && woken() == 1);
    world.tell(&node, 50_900);
    assert!(settles(&woken) && woken() == 1);
    world.tell(&node, 51_000);
    assert!(eventually(|| woken() == 2));
    world.tell(&node, 2_000_000);
    assert!(eventually(|| woken() == 3 + 7000));
    running.stop();
}
