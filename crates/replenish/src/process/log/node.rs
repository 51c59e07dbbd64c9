//! The loggers of nodes.

use super::logger::Logger;
use super::loggers::Log;
use crate::context::Node;
use crate::executor::Topic;
use crate::qos::Qos;
use core::time::Duration;
use std::string::String;
use std::sync::Arc;

/// The longest message on `/rosout`, in bytes.
const MESSAGE: usize = 1400;
const ROSOUT: Qos = Qos::reliable()
    .keep_last(1000)
    .transient_local()
    .lifespan(Duration::from_secs(10));

impl Node {
    /// The logger of this node, which publishes on `/rosout` besides: with the name of the node,
    /// `robot.arm` for `/robot/arm`. For set-up: the first call makes the publisher and, for a
    /// context, the thread that writes. Without `/rosout` a warning says why.
    ///
    /// The arguments `--log-level`, `--disable-stdout-logs` and `--disable-rosout-logs` apply.
    #[must_use]
    pub fn logger(&self) -> Logger {
        let log = self.context().loggers().log(self.context().args());
        let name: String = self.name().trim_start_matches('/').replace('/', ".");
        if let Some(named) = log.core().find(&name) {
            return Logger::new(named, Arc::clone(log));
        }
        let made = self
            .context()
            .args()
            .log()
            .rosout
            .then(|| self.publisher(Topic::named("/rosout").max_size(MESSAGE), ROSOUT));
        let (rosout, refused) = match made {
            None => (None, None),
            Some(Ok(publisher)) => (Some(publisher), None),
            Some(Err(e)) => (None, Some(e)),
        };
        let named = log.core().named(&name, rosout);
        let logger = Logger::new(named, Arc::clone(log));
        if let Some(e) = refused {
            crate::log_warn!(logger, "no /rosout: {e}");
        }
        logger
    }

    /// The log of this node's context.
    pub(super) fn log(&self) -> Arc<Log> {
        Arc::clone(self.context().loggers().log(self.context().args()))
    }
}
