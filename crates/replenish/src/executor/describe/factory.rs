//! Making handles: for workers that are described, and for those that run.

use super::topic::Topic;
use crate::context::{Context, Node, check_depth};
use crate::error::Error;
use crate::executor::handles::callback::{CallbackContext, CallbackResult};
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::guard::{Guard, GuardCondition};
use crate::executor::handles::in_memory::take_in_memory;
use crate::executor::handles::options::HandleOptions;
use crate::executor::handles::replies::Replies;
use crate::executor::handles::server::Server;
use crate::executor::handles::state::HandleState;
use crate::executor::handles::subscription::{RawSubscription, Subscription, ViewSubscription};
use crate::executor::handles::timer::{Timer, TimerHandle};
use crate::executor::wake::schedule::Every;
use crate::handoff::{Inbox, Keep};
use crate::middleware::remedy::LARGEST;
use crate::middleware::{EndpointSpec, ReaderId};
use crate::name::{concat, with_number};
use crate::platform::{STD, text};
use crate::process::Kind;
use crate::qos::{History, Qos};
use crate::service::client::Client;
use crate::service::error::NoReply;
use crate::service::responder::{ReplyWriter, Responder};
use crate::service::size::{checked, sizes};
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use alloc::string::String;
use core::time::Duration;
use replenish_msg::{Message, Service, Viewed};

/// The context in which handles are made.
pub struct HandleFactory<'a> {
    pub(crate) context: &'a Context,
    /// The worker's name.
    pub(crate) worker: &'a str,
    /// Makes an id unique.
    pub(crate) unique: &'a dyn Fn(String) -> String,
    /// Number of handles without a topic that the worker has had.
    pub(crate) number: usize,
}

/// A type by its names, for programs without a [`Message`] of it.
#[derive(Debug, Clone, Copy)]
pub struct RawType<'a> {
    /// The ROS name, `std_msgs/msg/Int32`.
    pub name: &'a str,
    /// The DDS name, `std_msgs::msg::dds_::Int32_`.
    pub dds_name: &'a str,
    /// The type's hash, `RIHS01_` and 64 hexadecimal digits, if it is known.
    pub type_hash: Option<&'a str>,
    /// The largest sample in bytes, 1..=268435456, unless a [`Topic`] says another one.
    pub max_size: usize,
}

impl RawType<'_> {
    /// The names and the size of `M`.
    #[must_use]
    pub const fn of<M: Message>() -> RawType<'static> {
        RawType {
            name: M::TYPE_NAME,
            dds_name: M::DDS_TYPE_NAME,
            type_hash: if STD { M::TYPE_HASH } else { None },
            max_size: M::MAX_SIZE,
        }
    }
}

impl HandleFactory<'_> {
    fn owned(&self, node: &Node) -> Result<(), Error> {
        if node.context().is(self.context) {
            Ok(())
        } else {
            Err(Error::ForeignNode(node.name().into()))
        }
    }

    /// A reader with its inbox.
    fn input(
        &self,
        node: &Node,
        topic: Topic<'_>,
        (ty, (usual, most)): (RawType<'_>, (usize, usize)),
        qos: Qos,
    ) -> Result<(String, ReaderId, Arc<Inbox>), Error> {
        self.owned(node)?;
        let name = node.resolve(Kind::Topic, topic.name)?;
        check_depth(&name, qos)?;
        let owner = || text!("topic {name}");
        let middleware = self.context.middleware();
        let usual = usual.min(middleware.longest(&qos, false));
        let size = checked(("topic", &name), topic.max_size, (usual, most), qos)?;
        if let Some((field, value, allowed)) = topic.ingress.violation() {
            return Err(Error::parameter(owner(), field, &value, allowed));
        }
        let keep = match (qos.history, topic.keep_oldest) {
            (History::KeepAll, false) => Keep::All,
            (History::KeepLast, false) => Keep::Newest,
            (History::KeepLast, true) => Keep::Oldest,
            (History::KeepAll, true) => {
                let (field, allowed) = ("keep_oldest", "with keep-last history only");
                return Err(Error::parameter(owner(), field, &true, allowed));
            }
        };
        let spec = EndpointSpec {
            node: node.name(),
            topic: &name,
            type_name: ty.name,
            dds_type_name: ty.dds_name,
            type_hash: ty.type_hash,
            qos,
            max_size: size,
            ingress: topic.ingress,
            keep_oldest: topic.keep_oldest,
        };
        let reader = middleware
            .create_reader(&spec)
            .map_err(|e| Error::endpoint("subscription", &name, e))?;
        let inbox = Arc::new(Inbox::new(qos.depth.into(), size, keep));
        let id = (self.unique)(concat(&[node.name(), "/sub:", &name]));
        Ok((id, reader, inbox))
    }

    pub(crate) fn subscription<M, F, R>(
        &self,
        node: &Node,
        topic: Topic<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        M: Message,
        F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let (id, reader, inbox) =
            self.input(node, topic, (RawType::of::<M>(), sizes::<M>()), qos)?;
        let shared = HandleState::new(id, Some((reader, Arc::clone(&inbox))));
        take_in_memory::<M>(&shared, &**self.context.middleware());
        let handle = Subscription::<M, F>::new(Arc::clone(&shared), inbox, callback);
        Ok(HandleEntry::new(shared, Box::new(handle)))
    }

    /// A subscription whose callback runs in every round of its worker.
    pub(crate) fn always<M, F, R>(
        &self,
        node: &Node,
        topic: Topic<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        M: Message,
        F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let mut entry = self.subscription(node, topic, qos, callback)?;
        entry.handling = HandleOptions::new().always();
        Ok(entry)
    }

    pub(crate) fn view<M, F, R>(
        &self,
        node: &Node,
        topic: Topic<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        M: Viewed,
        F: FnMut(&M::View<'_>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let (id, reader, inbox) =
            self.input(node, topic, (RawType::of::<M>(), sizes::<M>()), qos)?;
        let shared = HandleState::new(id, Some((reader, Arc::clone(&inbox))));
        let handle = ViewSubscription::<M, F>::new(Arc::clone(&shared), inbox, callback);
        Ok(HandleEntry::new(shared, Box::new(handle)))
    }

    pub(crate) fn raw<F, R>(
        &self,
        node: &Node,
        topic: Topic<'_>,
        ty: RawType<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        if !(1..=LARGEST).contains(&ty.max_size) {
            let owner = text!("topic {}", topic.name);
            let allowed = text!("1..={LARGEST} bytes");
            return Err(Error::parameter(owner, "max_size", &ty.max_size, allowed));
        }
        if ty.name.is_empty() || ty.dds_name.is_empty() {
            let owner = text!("topic {}", topic.name);
            let allowed = "a name and a DDS name";
            return Err(Error::parameter(owner, "type", &"\"\"", allowed));
        }
        let (id, reader, inbox) = self.input(node, topic, (ty, (ty.max_size, LARGEST)), qos)?;
        let shared = HandleState::new(id, Some((reader, Arc::clone(&inbox))));
        let handle = RawSubscription::new(Arc::clone(&shared), inbox, callback);
        Ok(HandleEntry::new(shared, Box::new(handle)))
    }

    pub(crate) fn timer<F, R>(
        &self,
        handle: Option<&TimerHandle>,
        every: Every,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        if every.period == Duration::ZERO && !every.once {
            let owner = text!("timer of worker {:?}", self.worker);
            return Err(Error::parameter(owner, "period", &0, "1 ns or more"));
        }
        self.timer_of(self.nameless("timer"), handle, every, callback)
    }

    /// A timer that belongs to something with a name, which is its id.
    pub(crate) fn named_timer<F, R>(
        &self,
        id: &str,
        handle: &TimerHandle,
        every: Every,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let shared = HandleState::new((self.unique)(id.into()), None);
        self.timer_of(shared, Some(handle), every, callback)
    }

    fn timer_of<F, R>(
        &self,
        shared: Arc<HandleState>,
        handle: Option<&TimerHandle>,
        every: Every,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        if let Some(handle) = handle {
            self.bound(handle.claim(), &shared)?;
        }
        let control = handle.map(TimerHandle::control);
        let timer = Timer::new(Arc::clone(&shared), every, control, callback);
        Ok(HandleEntry::new(shared, Box::new(timer)))
    }

    pub(crate) fn guard<F, R>(
        &self,
        guard: &GuardCondition,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.guard_of(self.nameless("guard"), guard, callback)
    }

    /// A guard condition that belongs to something with a name, which is its id.
    pub(crate) fn named_guard<F, R>(
        &self,
        id: &str,
        guard: &GuardCondition,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let shared = HandleState::new((self.unique)(id.into()), None);
        self.guard_of(shared, guard, callback)
    }

    fn guard_of<F, R>(
        &self,
        shared: Arc<HandleState>,
        guard: &GuardCondition,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.bound(guard.claim(), &shared)?;
        let handle = Guard::new(Arc::clone(&shared), guard.clone(), callback);
        Ok(HandleEntry::new(shared, Box::new(handle)))
    }

    pub(crate) fn server<S, F, R>(
        &self,
        node: &Node,
        topic: Topic<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        S: Service,
        F: FnMut(&S::Request, Responder<S>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.owned(node)?;
        let name = node.resolve(Kind::Service, topic.name)?;
        check_depth(&name, qos)?;
        let middleware = self.context.middleware();
        let spec = node.service::<S>(&name, topic, qos)?;
        let (reader, writer) = middleware
            .create_server(&spec)
            .map_err(|e| Error::endpoint("service", &name, e))?;
        let keep = match qos.history {
            History::KeepAll => Keep::All,
            History::KeepLast => Keep::Newest,
        };
        let inbox = Arc::new(Inbox::new(qos.depth.into(), spec.max_request, keep));
        let id = (self.unique)(concat(&[node.name(), "/srv:", &name]));
        let shared = HandleState::new(id, Some((reader, Arc::clone(&inbox))));
        let writer = ReplyWriter {
            middleware: self.context.share_middleware(),
            writer,
            buffer: Mutex::new(alloc::vec![0; spec.max_response].into()),
        };
        let handle = Server::<S, F>::new(
            Arc::clone(&shared),
            (inbox, spec.max_request),
            writer,
            callback,
        );
        Ok(HandleEntry::new(shared, Box::new(handle)))
    }

    pub(crate) fn replies<S, F, R>(
        &self,
        client: &Client<S>,
        callback: F,
    ) -> Result<HandleEntry, Error>
    where
        S: Service,
        F: FnMut(Result<&mut S::Response, NoReply>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let inner = &client.inner;
        if !client.is_of(self.context.middleware()) {
            return Err(Error::ForeignNode(inner.node.as_str().into()));
        }
        let id = (self.unique)(concat(&[&inner.node, "/cli:", &inner.name]));
        let shared = HandleState::new(id, Some((inner.reader, Arc::clone(&inner.inbox))));
        self.bound(client.claim(), &shared)?;
        let handle = Replies::<S, F>::new(Arc::clone(&shared), Arc::clone(inner), callback);
        Ok(HandleEntry::new(shared, Box::new(handle)))
    }

    fn nameless(&self, kind: &str) -> Arc<HandleState> {
        let id = with_number(&concat(&[self.worker, "/", kind, ":"]), self.number);
        HandleState::new((self.unique)(id), None)
    }

    fn bound(&self, free: bool, shared: &HandleState) -> Result<(), Error> {
        if free {
            Ok(())
        } else {
            Err(Error::parameter(
                text!("worker {:?}", self.worker),
                "handle",
                &shared.id,
                "one that belongs to no callback yet",
            ))
        }
    }
}
