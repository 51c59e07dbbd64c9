//! Samples of a megabyte allocate nothing either, once they have their memory.

use crate::ALLOC;
use crate::common::{eventually, executor};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::{Context, PublishError, Qos, Topic};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
use replenish_testkit::alloc::exempt_this_thread;
use replenish_testkit::domain::domain;
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("nothing_allocates_for_a_megabyte_in_one_process", || {
            let ctx = Context::in_process();
            allocations(&ctx, &ctx);
        }),
        trial("nothing_allocates_for_a_megabyte_that_is_lent", || {
            lent(false);
            lent(true);
        }),
        trial("nothing_allocates_for_a_megabyte_over_rtps", || {
            over_rtps(false);
        }),
        trial("nothing_allocates_for_a_megabyte_in_shared_memory", || {
            over_rtps(true);
        }),
    ]
}

fn over_rtps(shared_memory: bool) {
    let config = RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        shared_memory,
        ..RtpsConfig::default()
    };
    let [camera, viewer] = [(); 2].map(|()| Context::new(Rtps::open(&config).unwrap()));
    allocations(&camera, &viewer);
}

fn allocations(camera: &Context, viewer: &Context) {
    const IMAGES: u32 = 30;
    let _dog = watchdog("allocations for a megabyte", Duration::from_secs(180));
    let space = format!("p{}", std::process::id());
    let topic = Topic::named("image").max_size(1_000_100);
    let qos = Qos::reliable().keep_all(2);
    let node = camera.node(&format!("{space}/camera")).unwrap();
    let out = node.publisher::<Image>(topic, qos).unwrap();
    let node = viewer.node(&format!("{space}/viewer")).unwrap();
    let heard = Arc::new(AtomicU32::new(0));
    let count = Arc::clone(&heard);
    let (mut exec, _) = executor(viewer);
    exec.worker("viewer")
        .subscribe_view::<Image, _, _>(&node, topic, qos, move |image, _| {
            count.fetch_add(u32::from(image.data.len() == 1_000_000), Ordering::SeqCst);
        })
        .unwrap();
    let viewer = exec.start().unwrap();
    // In one process the viewer's dispatcher serves both.
    let camera = executor(camera).0.start().ok();
    let data = vec![7; 1_000_000];
    let image = ImageView {
        encoding: "mono8",
        data: &data,
        ..ImageView::default()
    };
    assert!(eventually(|| {
        out.publish_view(&image).ok();
        std::thread::sleep(Duration::from_millis(50));
        heard.load(Ordering::SeqCst) > 0
    }));
    assert!(eventually(|| {
        let before = heard.load(Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(300));
        before == heard.load(Ordering::SeqCst)
    }));
    let first = heard.load(Ordering::SeqCst);
    exempt_this_thread();
    ALLOC.arm();
    for _ in 0..IMAGES {
        while let Err(error) = out.publish_view(&image) {
            assert_eq!(error, PublishError::Full);
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let all = || heard.load(Ordering::SeqCst) - first >= IMAGES;
    assert!(eventually(all), "{heard:?}");
    let counted = ALLOC.disarm();
    let report = viewer.stop();
    drop(camera.map(replenish::RunningExecutor::stop));
    assert_eq!(counted, 0, "{report}");
}

/// Three workers read each image where it was filled. They are slow, so the publisher finds its
/// pool empty. With `bytes`, a fourth worker needs the image encoded.
fn lent(bytes: bool) {
    const IMAGES: u32 = 100;
    let _dog = watchdog(
        "allocations for a megabyte that is lent",
        Duration::from_secs(180),
    );
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let topic = Topic::named("image").max_size(1_000_100);
    let qos = Qos::reliable().keep_last(4);
    let out = node.publisher::<Image>(topic, qos).unwrap();
    let made = || Image {
        data: vec![0; 1_000_000],
        ..Image::default()
    };
    let pool = out.pool(3, made).unwrap();
    let heard = Arc::new(AtomicU32::new(0));
    let (mut exec, _) = executor(&ctx);
    for worker in ["a", "b", "c"] {
        let count = Arc::clone(&heard);
        exec.worker(worker)
            .subscribe(&node, topic, qos, move |image: &Image, _| {
                count.fetch_add(u32::from(image.data[999_999] == 7), Ordering::SeqCst);
                std::thread::sleep(Duration::from_micros(300));
            })
            .unwrap();
    }
    if bytes {
        exec.worker("d")
            .subscribe_view::<Image, _, _>(&node, topic, qos, |_, _| ())
            .unwrap();
    }
    let running = exec.start().unwrap();
    // All that are lent fit into each inbox, so all are read. This thread counts, too.
    let send = |images: u32| {
        let (mut sent, mut refused) = (0, 0);
        while sent < images {
            match pool.loan() {
                Ok(mut image) => {
                    image.data[999_999] = 7;
                    image.publish().unwrap();
                    sent += 1;
                }
                Err(error) => {
                    assert_eq!(error, PublishError::AllLent { size: 3 });
                    refused += 1;
                    std::thread::sleep(Duration::from_micros(100));
                }
            }
        }
        assert!(eventually(|| pool.free() == 3));
        refused
    };
    send(10);
    ALLOC.arm();
    let refused = send(IMAGES);
    let counted = ALLOC.disarm();
    let report = running.stop();
    assert_eq!(counted, 0, "{report}");
    assert_eq!(heard.load(Ordering::SeqCst), 3 * (IMAGES + 10), "{report}");
    assert!(bytes || refused > 0, "{report}");
}
