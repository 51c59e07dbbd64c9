//! Latency and response of each handle in the last second, for `/statistics`.

use super::texts::{put, with_room};
use crate::window::Window;
use replenish_interfaces::statistics_msgs::msg::{MetricsMessage, StatisticDataPoint};
use replenish_msg::builtin_interfaces::Time;
use std::vec::Vec;

/// Bytes of a handle's id, at most.
const ID: usize = 512;
/// Bytes of the encoded message, at most.
pub(super) const MOST: usize = ID + 256;

/// The message, which is used again.
pub(super) struct Metrics(MetricsMessage);

impl Metrics {
    pub(super) fn new() -> Self {
        Self(MetricsMessage {
            measurement_source_name: with_room(ID),
            metrics_source: with_room(16),
            unit: "ms".into(),
            window_start: Time::default(),
            window_stop: Time::default(),
            statistics: Vec::with_capacity(5),
        })
    }

    /// The values of one handle. Does not allocate.
    pub(super) fn of(
        &mut self,
        id: &str,
        source: &'static str,
        (start, stop): (Time, Time),
        seen: &Window,
    ) -> &MetricsMessage {
        let message = &mut self.0;
        put(
            &mut message.measurement_source_name,
            ID,
            format_args!("{id}"),
        );
        put(&mut message.metrics_source, 16, format_args!("{source}"));
        (message.window_start, message.window_stop) = (start, stop);
        let ms = |ns: f64| ns / 1e6;
        // AVERAGE, MINIMUM, MAXIMUM, STDDEV and SAMPLE_COUNT of StatisticDataType.msg.
        let points = [
            (1, ms(seen.average)),
            (2, ms(seen.min as f64)),
            (3, ms(seen.max as f64)),
            (4, ms(seen.variance.sqrt())),
            (5, seen.count as f64),
        ];
        message.statistics.clear();
        let points = points.map(|(data_type, data)| StatisticDataPoint { data_type, data });
        message.statistics.extend(points);
        message
    }
}
