//! Changes the trigger of a worker that runs.

use super::worker_handle::WorkerHandle;
use crate::error::Error;
use crate::executor::run::mailbox::NotSent;
use crate::executor::run::rules::Trigger;
use crate::platform::text;

impl WorkerHandle<'_> {
    /// Gives this worker another trigger, from the end of the running callback on. Waiting input
    /// stays. Any thread may call this, callbacks of the worker included. The worker neither
    /// allocates nor frees for it: a later call drops what the old trigger owns, or the end of the
    /// executor does.
    ///
    /// ```
    /// # use replenish::{Context, Executor, GuardCondition, Trigger};
    /// # let ctx = Context::in_process();
    /// # let mut exec = Executor::new(&ctx);
    /// let (left, right) = (GuardCondition::new(), GuardCondition::new());
    /// exec.worker("both")
    ///     .guard(&left, |_| ())?
    ///     .guard(&right, |_| ())?;
    /// let running = exec.start()?;
    /// running.handle().worker("both")?.set_trigger(Trigger::All)?;
    /// # Ok::<(), replenish::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Parameter`] for a trigger that waits for a handle which is not this worker's, and
    /// for [`Trigger::Always`] where no clock begins rounds
    /// ([`WorkerBuilder::every`](crate::WorkerBuilder::every)); [`Error::Capacity`] while too many
    /// triggers are on their way to the worker; [`Error::Stopped`].
    pub fn set_trigger(self, trigger: Trigger) -> Result<(), Error> {
        let (live, post) = self.place();
        let owner = || text!("worker {:?}", &*post.name);
        let its_own = |id: &str| {
            let known = live.registry.find(id);
            known.is_some_and(|(worker, _)| worker == post.name)
        };
        match &trigger {
            Trigger::Always if !post.clocked => {
                let allowed = "with .every(…) only: something has to start the rounds";
                return Err(Error::parameter(owner(), "trigger", &"Always", allowed));
            }
            Trigger::One(id) if !its_own(id) => {
                let allowed = "a handle of this worker";
                return Err(Error::parameter(owner(), "trigger", id, allowed));
            }
            _ => {}
        }
        post.mailbox.set_trigger(trigger).map_err(|why| match why {
            NotSent::Ended => Error::Stopped,
            NotSent::TooMany(limit) => Error::Capacity {
                what: text!("triggers on their way to worker {:?}", &*post.name),
                limit,
            },
        })
    }
}
