//! A camera and three workers that read its images where it has filled them.
//!
//! The camera borrows an image of a megabyte from its pool, fills it in place and publishes it. All
//! three callbacks get `&Image` of that very memory: nothing is serialised, nothing is copied. An
//! image is free again when the last of them has ended; while all are in use, `loan` says so.
//!
//! Run: `cargo run -p replenish --example camera`.

use replenish::interfaces::sensor_msgs::msg::Image;
use replenish::{Context, Error, Executor, Qos, Topic};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

const PIXELS: usize = 1_000_000;

fn main() -> Result<(), Error> {
    let ctx = Context::in_process();
    let node = ctx.node("camera")?;
    let topic = Topic::named("image").max_size(PIXELS + 200);
    let qos = Qos::sensor_data().keep_last(2);
    // One is filled; at each of three workers two can wait, and one is read.
    let images = node.publisher::<Image>(topic, qos)?.pool(10, || Image {
        encoding: "mono8".into(),
        data: vec![0; PIXELS],
        ..Image::default()
    })?;

    let mut exec = Executor::new(&ctx);
    let (place, copied) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    for reader in ["viewer", "tracker", "recorder"] {
        let (place, copied) = (Arc::clone(&place), Arc::clone(&copied));
        exec.worker(reader)
            .subscribe(&node, topic, qos, move |image: &Image, _| {
                println!("{reader}: image {}", image.height);
                let here = image.data.as_ptr() as usize;
                copied.fetch_add(
                    usize::from(here != place.load(Ordering::SeqCst)),
                    Ordering::SeqCst,
                );
            })?;
    }
    let mut number = 0;
    exec.worker("camera")
        .timer(Duration::from_millis(50), move |cx| {
            if number == 10 {
                cx.stop();
                return Ok(());
            }
            number += 1;
            let mut image = images.loan()?;
            image.height = number;
            image.data.fill(u8::try_from(number).unwrap_or(0));
            place.store(image.data.as_ptr() as usize, Ordering::SeqCst);
            image.publish()
        })?;
    exec.spin()?;
    println!("copied: {}", copied.load(Ordering::SeqCst));
    Ok(())
}
