//! `on_event`: a callback for the events of a publisher or subscription.

use super::event::{QosEvent, between};
use super::source::{EventSource, Source};
use super::watch::{EventWatch, Look};
use crate::error::Error;
use crate::executor::{
    AddHandles, CallbackContext, CallbackResult, GuardCondition, Numbering, Target,
};
use crate::middleware::{End, EndStatus, Watch};
use crate::name::concat;
use crate::platform::text;
use crate::sync::Arc;

impl<T: Target> AddHandles<T> {
    /// Calls `callback` for each change of an endpoint: peers that match or do not,
    /// samples that were lost. The endpoint is a publisher of this executor's context, or a
    /// subscription of this executor by its handle's id. Peers that are there already are the
    /// first event.
    ///
    /// The callback runs on this worker, on its budget. The middleware keeps counts and no queue,
    /// so no event is lost: several changes in between come as one.
    ///
    /// ```
    /// use replenish::msg::std_msgs::Int32;
    /// use replenish::{Context, Executor, Qos, QosEvent};
    /// let ctx = Context::in_process();
    /// let node = ctx.node("n")?;
    /// let out = node.publisher::<Int32>("number", Qos::reliable())?;
    /// let mut exec = Executor::new(&ctx);
    /// exec.worker("w")
    ///     .subscribe(&node, "number", Qos::reliable(), |_: &Int32, _| ())?
    ///     .on_event(&out, |event, cx| {
    ///         if let QosEvent::Matched { current, .. } = event {
    ///             println!("{} subscriptions", current.total);
    ///             cx.stop();
    ///         }
    ///     })?
    ///     .on_event("/n/sub:/number", |event, _| println!("{event:?}"))?;
    /// exec.spin()?;
    /// # Ok::<(), replenish::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Parameter`] if no subscription or service of this executor has that id;
    /// [`Error::ForeignNode`] for a publisher of another context; [`Error::Middleware`] where the
    /// middleware does not know, which is DDS-XRCE, and if the endpoint has a callback already.
    pub fn on_event<'s, F, R>(
        mut self,
        of: impl Into<EventSource<'s>>,
        mut callback: F,
    ) -> Result<T::Added, Error>
    where
        F: FnMut(&QosEvent, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let EventSource(source) = of.into();
        let (end, name) = match source {
            Source::Publisher { writer, topic, .. } => (End::Writer(writer), topic),
            Source::Handle(id) => {
                let reader = self.0.reader_of(id).ok_or_else(|| {
                    let allowed = "a publisher, or the id of a subscription or service";
                    Error::parameter(text!("on_event"), "of", &id, allowed)
                })?;
                (End::Reader(reader), id)
            }
        };
        let guard = GuardCondition::new();
        let watch = Arc::new(EventWatch::new(guard.clone()));
        let look = Look(Arc::clone(&watch));
        let mut last = EndStatus::default();
        let called = move |cx: &CallbackContext<'_>| {
            let now = look.take();
            for event in between(core::mem::replace(&mut last, now), now) {
                let result = callback(&event, cx);
                result.inspect(&mut |error| cx.shared.failed(error, cx.env.events));
            }
        };
        self.0.add(Numbering::None, |factory| {
            let middleware = factory.context.middleware();
            if let Source::Publisher { middleware: of, .. } = source
                && !Arc::ptr_eq(middleware, of)
            {
                return Err(Error::ForeignNode(name.into()));
            }
            let id = concat(&[factory.worker, "/events:", name]);
            let entry = factory.named_guard(&id, &guard, called)?;
            let watch: Arc<dyn Watch> = watch;
            let watched = middleware.watch(end, &watch);
            watched.map_err(|error| Error::endpoint("events of", name, error))?;
            Ok(entry)
        })
    }
}
