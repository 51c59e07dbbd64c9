//! Images of a megabyte, both ways.

use crate::peer::{Foreign, Peer};
use crate::support::{eventually, executor, node};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::{Budget, Context, Qos, Topic};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Whether the pixels are those that the peer gives this image. Row by row: byte by byte takes
/// longer in a test that is not optimised than the next image needs to come.
pub(crate) fn is_right(image: &ImageView<'_>) -> bool {
    let row = (0..10_000).map(|place| ((image.height * 31 + place) % 251) as u8);
    let row: Vec<_> = row.collect();
    image.data.len() == 1_000_000 && image.data.chunks(row.len()).all(|data| data == row)
}

/// 20 images of a megabyte from rclpy come back to it through a worker with a budget. Another
/// participant of ours gets the same ones, from the memory of their publisher.
pub(crate) fn images(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let mut exec = executor(&node);
    let topic = |name| Topic::named(name).max_size(1_000_100);
    let qos = Qos::reliable().keep_last(3);
    let back = node
        .publisher::<Image>(topic("image_from_ours"), qos)
        .unwrap();
    exec.worker("images")
        .budget(Budget::of(Duration::from_millis(60)).every(Duration::from_millis(100)))
        .subscribe_view::<Image, _, _>(&node, topic("image_to_ours"), qos, move |image, _| {
            back.publish_view(image)
        })
        .unwrap();
    let running = exec.start().unwrap();
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    let participant = Arc::new(Rtps::open(&config).unwrap());
    let beside = Context::new(Arc::clone(&participant));
    let beside = beside.node("/peer/beside").unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    let mut exec = executor(&beside);
    let note = Arc::clone(&seen);
    exec.worker("beside")
        .subscribe_view::<Image, _, _>(&beside, topic("image_from_ours"), qos, move |image, _| {
            assert!(is_right(image), "image {}", image.height);
            note.lock().unwrap().push(image.height);
        })
        .unwrap();
    let beside = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["images", "20"]);
    assert_eq!(peer.line(), "images 20 of 20");
    let numbers = || -> Vec<u32> {
        let seen = seen.lock().unwrap();
        seen.iter().copied().filter(|number| *number > 0).collect()
    };
    assert!(eventually(|| numbers().len() == 20), "{:?}", numbers());
    assert_eq!(numbers(), (1..=20).collect::<Vec<_>>());
    assert!(
        participant.stats().shared >= 20,
        "{:?}",
        participant.stats()
    );
    drop((running.stop(), beside.stop()));
}
