//! A publication over RTPS: encoded where the writer keeps it, and copied there from a buffer.
//!
//! The writer has no readers, so nothing but the way of the bytes is measured. Both take turns.

use crate::load::spec::SUPPORT_PRIORITY;
use replenish::interfaces::std_msgs::msg::UInt8MultiArrayView;
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::middleware::{EndpointSpec, Middleware, WriterId};
use replenish::msg::View;
use replenish::{IngressLimit, Qos};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::{ThreadSpec, clock, spawn};

/// Publications of each kind and size.
const SAMPLES: usize = 200;
/// CDR of a sample without data.
const HEAD: usize = 12;

/// One size. The names are a contract: docs/schemas/bench-ros2.json.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct Encoding {
    pub(super) bytes: usize,
    /// CPU time of a publication that is encoded where it is kept.
    pub(super) in_place_us: f64,
    /// CPU time of one that is encoded into a buffer and copied.
    pub(super) copied_us: f64,
}

/// Measures each size on a thread of its own on `cpu`.
pub(super) fn measure(bytes: &[usize], cpu: usize, domain: u16) -> Result<Vec<Encoding>, Failure> {
    let bytes = bytes.to_vec();
    on_cpu(cpu, move || {
        bytes.iter().map(|bytes| one(*bytes, domain)).collect()
    })
}

/// Does some work on a thread of its own with the priority of the paths.
pub(super) fn on_cpu<T: Send + 'static>(
    cpu: usize,
    work: impl FnOnce() -> Result<T, Failure> + Send + 'static,
) -> Result<T, Failure> {
    let spec = ThreadSpec::new("bench-bytes")
        .policy(fifo_or_other(SUPPORT_PRIORITY))
        .cpu(cpu);
    let measured = spawn(spec, work).map_err(Failure::refused)?.join();
    measured.map_err(|_| Failure::refused("the benchmark's thread panicked"))?
}

fn one(bytes: usize, domain: u16) -> Result<Encoding, Failure> {
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Off,
        ..RtpsConfig::default()
    };
    let rtps = Rtps::open(&config).map_err(Failure::refused)?;
    let writer = rtps.create_writer(&EndpointSpec {
        node: "/bench",
        topic: "/encoding",
        type_name: "std_msgs/msg/UInt8MultiArray",
        dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
        type_hash: None,
        qos: Qos::reliable().keep_last(1),
        max_size: bytes,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    });
    let writer = writer.map_err(Failure::refused)?;
    let data = vec![7; bytes.saturating_sub(HEAD)];
    let view = UInt8MultiArrayView {
        data: &data,
        ..UInt8MultiArrayView::default()
    };
    let mut buffer = vec![0; bytes];
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..SAMPLES {
        let began = clock::thread_cpu();
        in_place(&rtps, writer, &view)?;
        let middle = clock::thread_cpu();
        let len = view.encode_to(&mut buffer).map_err(Failure::refused)?;
        let payload = buffer.get(..len).unwrap_or_default();
        rtps.publish(writer, payload).map_err(Failure::refused)?;
        let took = [middle - began, clock::thread_cpu() - middle];
        for (times, took) in times.iter_mut().zip(took) {
            times.push(i64::try_from(took).unwrap_or(i64::MAX));
        }
    }
    let [in_place_us, copied_us] = times.map(|times| us(Sorted::new(times).median()));
    Ok(Encoding {
        bytes,
        in_place_us,
        copied_us,
    })
}

fn in_place(rtps: &Rtps, writer: WriterId, view: &UInt8MultiArrayView<'_>) -> Outcome {
    let sent = rtps.publish_with(writer, &mut |room| view.encode_to(room).ok());
    let nowhere = || Failure::refused("the writer has no place to encode in");
    sent.ok_or_else(nowhere)?.map_err(Failure::refused)
}
