//! Images of a megabyte, both ways.

use crate::peer::{Foreign, Peer};
use crate::support::{executor, node};
use replenish::{Budget, Qos, Topic};
use replenish_interfaces::sensor_msgs::msg::Image;
use std::time::Duration;

/// 20 images of a megabyte from rclpy come back to it through a worker with a budget.
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
    let peer = Peer::start(foreign, domain, &["images", "20"]);
    assert_eq!(peer.line(), "images 20 of 20");
    drop(running.stop());
}
