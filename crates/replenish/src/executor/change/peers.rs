//! The publishers of a running executor's subscriptions: how many there are, and waiting for one.

use super::handle::ExecutorHandle;
use crate::error::Error;
use crate::executor::wake::schedule::nanos;
use crate::middleware::{MiddlewareError, ReaderId};
use crate::platform::{label, text};
use core::time::Duration;
use replenish_os::clock;

impl ExecutorHandle {
    /// Number of publishers whose messages a subscription gets at this moment, those of other
    /// programs included; `None` where the middleware does not know it: DDS-XRCE. Does not wait.
    ///
    /// # Errors
    /// [`Error::UnknownHandle`]; [`Error::Parameter`] for a timer and other handles without input.
    pub fn publishers(&self, id: impl AsRef<str>) -> Result<Option<usize>, Error> {
        let reader = self.reader(id.as_ref())?;
        Ok(self.live.context.middleware().matched_writers(reader))
    }

    /// Waits for at most `limit` until a subscription has a publisher; looks every millisecond. For
    /// set-up: a worker that waits runs no other callback.
    ///
    /// ```
    /// # use replenish::{Context, Error, Executor, Qos, msg::std_msgs::Int32};
    /// # use std::time::Duration;
    /// # fn main() -> Result<(), Error> {
    /// # let ctx = Context::in_process();
    /// # let node = ctx.node("n")?;
    /// # let mut exec = Executor::new(&ctx);
    /// exec.worker("w")
    ///     .subscribe(&node, "number", Qos::reliable(), |_: &Int32, _| ())?;
    /// let running = exec.start()?;
    /// let _out = node.publisher::<Int32>("number", Qos::reliable())?;
    /// let limit = Duration::from_secs(1);
    /// assert!(running.handle().wait_for_publisher("/n/sub:/number", limit)?);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The errors of [`publishers`](Self::publishers), also when the handle is removed meanwhile;
    /// [`Error::Stopped`] when the executor stops; [`Error::Middleware`] where the middleware does
    /// not know: DDS-XRCE.
    pub fn wait_for_publisher(&self, id: impl AsRef<str>, limit: Duration) -> Result<bool, Error> {
        let id = id.as_ref();
        let deadline = clock::monotonic().saturating_add(nanos(limit));
        loop {
            match self.publishers(id)? {
                None => {
                    let unknown = label("to know of publishers, which no agent tells");
                    let unknown = MiddlewareError::Unsupported(unknown);
                    return Err(Error::endpoint("subscription", id, unknown));
                }
                Some(0) if self.live.stop.is_stopping() => return Err(Error::Stopped),
                Some(0) if clock::monotonic() >= deadline => return Ok(false),
                Some(0) => clock::sleep_until(clock::monotonic().saturating_add(1_000_000)),
                Some(_) => return Ok(true),
            }
        }
    }

    fn reader(&self, id: &str) -> Result<ReaderId, Error> {
        let found = self.live.registry.find(id);
        let (_, shared) = found.ok_or_else(|| Error::UnknownHandle(id.into()))?;
        let (reader, _) = shared.input.as_ref().ok_or_else(|| {
            let allowed = "the id of a subscription or service";
            Error::parameter(text!("publishers"), "of", &id, allowed)
        })?;
        Ok(*reader)
    }
}
