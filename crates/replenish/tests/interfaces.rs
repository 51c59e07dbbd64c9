//! Generated messages with unbounded fields through an executor: large ones, views of raw bytes,
//! publishing from a view, and errors that name the field.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod common;

use common::{eventually, executor};
use replenish::msg::{CdrError, CdrReader, CdrWriter, Message, View};
use replenish::{Context, Error, Qos, RawType, Topic};
use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
use replenish_interfaces::std_msgs::msg::HeaderView;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);

#[test]
fn an_image_goes_through_owned_and_as_a_view() {
    let _dog = watchdog("images", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    let size = 20_000;
    let out = node.publisher_sized::<Image>("image", qos, size).unwrap();
    let (owned, seen) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(0)));
    let (to_owned, to_seen) = (Arc::clone(&owned), Arc::clone(&seen));
    let raw = RawType {
        max_size: size,
        ..RawType::of::<Image>()
    };
    exec.worker("w")
        .subscribe(
            &node,
            Topic::named("image").max_size(size),
            qos,
            move |image: &Image, _| to_owned.lock().unwrap().push(image.clone()),
        )
        .unwrap()
        .subscribe_raw(&node, "image", raw, qos, move |bytes, _| {
            let image = ImageView::from_payload(bytes).unwrap();
            assert_eq!((image.header.frame_id, image.encoding), ("camera", "mono8"));
            *to_seen.lock().unwrap() += image.data.len();
        })
        .unwrap();
    let running = exec.start().unwrap();
    let pixels = [7; 16_384];
    let view = ImageView {
        header: HeaderView {
            frame_id: "camera",
            ..Default::default()
        },
        encoding: "mono8",
        data: &pixels,
        ..Default::default()
    };
    out.publish_view(&view).unwrap();
    out.publish(&Image::from(view)).unwrap();
    assert!(eventually(|| *seen.lock().unwrap() == 2 * pixels.len()));
    assert!(eventually(|| owned.lock().unwrap().len() == 2));
    drop(running.stop());
    let owned = owned.lock().unwrap();
    assert_eq!(owned[0], owned[1]);
    assert_eq!(owned[0].data, pixels);
}

#[test]
fn sizes_out_of_range_are_refused_with_the_range() {
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    for size in [0, 65_529] {
        let error = node
            .publisher_sized::<Image>("image", qos, size)
            .unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
        assert!(error.to_string().contains("1..=65528 bytes"), "{error}");
        let topic = Topic::named("image").max_size(size);
        let worker = exec.worker("w");
        let error = worker.subscribe(&node, topic, qos, |_: &Image, _| ());
        assert!(
            error
                .map(drop)
                .unwrap_err()
                .to_string()
                .contains("1..=65528 bytes")
        );
    }
}

/// What claims to be an image and ends in its first string.
#[derive(Default)]
struct Cut;

impl Message for Cut {
    const TYPE_NAME: &'static str = Image::TYPE_NAME;
    const DDS_TYPE_NAME: &'static str = Image::DDS_TYPE_NAME;
    const MAX_SIZE: usize = 16;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.u64(0)?;
        w.u32(9)
    }

    fn decode(&mut self, _: &mut CdrReader<'_>) -> Result<(), CdrError> {
        Ok(())
    }
}

#[test]
fn a_sample_that_is_none_is_told_with_the_field() {
    let _dog = watchdog("cut image", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Cut>("image", Qos::reliable()).unwrap();
    exec.worker("w")
        .subscribe(&node, "image", Qos::reliable(), |_: &Image, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    out.publish(&Cut).unwrap();
    let expected = "header.frame_id: needs 9 bytes, 0 left";
    assert!(eventually(|| log.has(expected)), "{:?}", log.lines());
    drop(running.stop());
}
