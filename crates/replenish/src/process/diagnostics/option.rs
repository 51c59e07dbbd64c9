//! The option of an executor.

use super::choice::DiagnosticsChoice;
use crate::executor::Executor;

impl Executor {
    /// Whether the executor publishes `/diagnostics` and `/statistics` once a second, from an
    /// ordinary thread and as publishers of the context's first node. Default: yes where the
    /// context is ROS 2's own ([`Context::ros2`](crate::Context::ros2)), else no.
    ///
    /// A `diagnostic_msgs/msg/DiagnosticArray` has a status for the dispatcher and for each worker,
    /// named `program: worker`, and for each chain, `program: chain NAME`. Of the last second it is
    /// ERROR if a callback of a worker with an admitted guarantee ended late, a callback panicked,
    /// or the enforcer was held up by more than 0.5 ms ([`Stall`](crate::Stall)); it is WARN if a
    /// budget was used up, a callback of another worker ended late or failed, a sample was dropped,
    /// or an instance of a chain took longer than its limit.
    ///
    /// A `statistics_msgs/msg/MetricsMessage` for each handle that ran in the last second, and for
    /// each of `latency` (from release to the start of the callback) and `response` (to its end),
    /// has mean, minimum, maximum, standard deviation and count, in milliseconds.
    pub fn diagnostics(&mut self, publish: bool) -> &mut Self {
        self.options.diagnostics = DiagnosticsChoice(Some(publish));
        self
    }
}
