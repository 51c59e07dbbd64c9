//! Transient local: a subscription that comes late gets what was published before, if both sides
//! want that; in one process and through the agent.

use crate::common::{eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Qos};
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

fn late_subscriptions_get_what_is_kept(ctx: &Context) {
    let _dog = watchdog("durability", Duration::from_secs(60));
    let node = ctx.node("n").unwrap();
    let kept = Qos::reliable().keep_last(3).transient_local();
    let out = node.publisher::<Int32>("t", kept).unwrap();
    let (mut exec, _) = executor(ctx);
    exec.worker("w").capacity(3);
    let running = exec.start().unwrap();
    for data in 1..=9 {
        out.publish(&Int32 { data }).unwrap();
    }
    let [late, volatile] = [(); 2].map(|()| Arc::new(Mutex::new(Vec::new())));
    for (heard, qos) in [(&volatile, Qos::reliable()), (&late, kept)] {
        let heard = Arc::clone(heard);
        let change = running.handle();
        let worker = change.worker("w").unwrap();
        worker
            .subscribe(&node, "t", qos, move |m: &Int32, _| {
                heard.lock().unwrap().push(m.data);
            })
            .unwrap();
    }
    assert!(eventually(|| late.lock().unwrap().len() == 3));
    assert_eq!(*late.lock().unwrap(), [7, 8, 9]);
    out.publish(&Int32 { data: 10 }).unwrap();
    assert!(eventually(|| volatile.lock().unwrap().len() == 1));
    assert!(eventually(|| late.lock().unwrap().len() == 4));
    assert_eq!(*volatile.lock().unwrap(), [10]);
    drop(out); // what it has kept goes with it
    let change = running.handle();
    let worker = change.worker("w").unwrap();
    let id = worker
        .subscribe(&node, "t", kept, |_: &Int32, _| ())
        .unwrap();
    std::thread::sleep(Duration::from_millis(20));
    assert_eq!(running.stats(&id).unwrap().received, 0);
}

#[test]
fn late_subscriptions_get_what_is_kept_in_one_process() {
    late_subscriptions_get_what_is_kept(&Context::in_process());
}

#[cfg(feature = "xrce")]
#[test]
fn late_subscriptions_get_what_is_kept_through_the_agent() {
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    late_subscriptions_get_what_is_kept(&agent.context());
}

#[test]
fn late_subscriptions_get_what_is_kept_over_rtps() {
    use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
    let config = RtpsConfig {
        range: DiscoveryRange::Off,
        ..RtpsConfig::default()
    };
    late_subscriptions_get_what_is_kept(&Context::new(Rtps::open(&config).unwrap()));
}
