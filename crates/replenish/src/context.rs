//! The connection to a middleware, and the nodes in it.

use crate::error::Error;
use crate::executor::{StopHandle, Topic};
use crate::middleware::{EndpointSpec, InProcessBus, LinkState, Middleware, ServiceSpec};
use crate::name;
use crate::platform::{STD, text};
use crate::process::{Args, Ends, FirstNode, Kind, Loggers, NodeTime, Presence, SimClock, Watched};
use crate::publisher::Publisher;
use crate::qos::{IngressLimit, Qos};
use crate::service::size::{checked, largest, sized, sizes};
use crate::sync::{Arc, AtomicBool, Ordering};
use alloc::boxed::Box;
use alloc::string::String;
use core::fmt;
use replenish_msg::{Message, Service};

/// A connection to a middleware: where nodes live and which one [`Executor`](crate::Executor)
/// spins. Clones are the same connection. Any thread may use it.
#[derive(Clone)]
pub struct Context {
    inner: Arc<Inner>,
}

struct Inner {
    middleware: Arc<dyn Middleware>,
    /// An executor's dispatcher waits on the middleware at this moment.
    spinning: AtomicBool,
    args: Args,
    ends: Ends,
    clock: SimClock,
    loggers: Loggers,
    first_node: FirstNode,
}

impl Context {
    /// A context over any middleware.
    #[must_use]
    pub fn new(middleware: impl Middleware) -> Self {
        let middleware = (Box::new(middleware) as Box<dyn Middleware>).into();
        Self::of(middleware, Default::default(), Default::default())
    }

    fn of(middleware: Arc<dyn Middleware>, args: Args, ends: Ends) -> Self {
        Self {
            inner: Arc::new(Inner {
                middleware,
                spinning: AtomicBool::new(false),
                args,
                ends,
                clock: Default::default(),
                loggers: Default::default(),
                first_node: Default::default(),
            }),
        }
    }

    /// The same connection with these arguments, and signals that stop as before.
    #[allow(dead_code, reason = "there are no arguments without feature `std`")]
    pub(crate) fn with_process_args(self, args: Args) -> Self {
        let ends = self.inner.ends.clone();
        Self::of(self.share_middleware(), args, ends)
    }

    #[allow(dead_code, reason = "there is no simulation without feature `std`")]
    pub(crate) fn sim_clock(&self) -> &SimClock {
        &self.inner.clock
    }

    #[allow(dead_code, reason = "there are no loggers without feature `std`")]
    pub(crate) fn loggers(&self) -> &Loggers {
        &self.inner.loggers
    }

    #[allow(dead_code, reason = "nobody asks for it without feature `std`")]
    pub(crate) fn first_node(&self) -> &FirstNode {
        &self.inner.first_node
    }

    /// The node that has this name in full.
    pub(crate) fn existing(&self, name: &str) -> Result<Node, Error> {
        let name: Arc<str> = name.into();
        Ok(Node {
            presence: Presence::of(&self.inner.middleware, &name)?,
            context: self.clone(),
            time: self.inner.args.time(&name, &self.inner.clock),
            name,
        })
    }

    pub(crate) fn process_args(&self) -> &Args {
        &self.inner.args
    }

    #[allow(dead_code, reason = "there are no signals without feature `std`")]
    pub(crate) fn ends(&self) -> &Ends {
        &self.inner.ends
    }

    /// A context of its own inside this process: what its nodes publish reaches its nodes.
    ///
    /// Several contexts that shall hear each other come from one [`InProcessBus`].
    #[must_use]
    pub fn in_process() -> Self {
        Self::new(InProcessBus::new().participant())
    }

    /// A node. `name` may carry a namespace: `pong`, `robot/pong` and `/robot/pong` are all right.
    /// The arguments (`--ros-args`) of a program may give it another name.
    ///
    /// Others see the node until its last clone and its last endpoint are gone; through an agent,
    /// and without feature `std`, from its first endpoint on.
    ///
    /// # Errors
    /// [`Error::Name`] for a name that ROS does not allow; [`Error::Middleware`] where the context
    /// has no room for a further node.
    pub fn node(&self, name: &str) -> Result<Node, Error> {
        let full = self.inner.args.node(name, name::node(name)?)?;
        self.inner.first_node.note(&full);
        self.existing(&full)
    }

    /// Whether samples can be exchanged at the moment.
    #[must_use]
    pub fn link(&self) -> LinkState {
        self.inner.middleware.link()
    }

    pub(crate) fn middleware(&self) -> &Arc<dyn Middleware> {
        &self.inner.middleware
    }

    /// The middleware for one more holder. (One body for all of them.)
    #[inline(never)]
    pub(crate) fn share_middleware(&self) -> Arc<dyn Middleware> {
        Arc::clone(&self.inner.middleware)
    }

    /// Whether both are the same connection.
    pub(crate) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.inner, &other.inner)
    }

    /// Claims the right to wait and take for an executor that `stop` ends; `None` while another
    /// executor has it.
    pub(crate) fn claim(&self, stop: &StopHandle) -> Option<Claim> {
        let taken = self.inner.spinning.swap(true, Ordering::AcqRel);
        (!taken).then(|| Claim {
            context: self.clone(),
            _watched: self.inner.ends.watch(stop),
        })
    }
}

impl fmt::Debug for Context {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Context")
            .field("link", &self.link())
            .finish_non_exhaustive()
    }
}

/// The right to wait on and take from a context's middleware, until dropped.
#[derive(Debug)]
pub(crate) struct Claim {
    context: Context,
    _watched: Watched,
}

impl Drop for Claim {
    fn drop(&mut self) {
        self.context.inner.loggers.flush();
        self.context.inner.spinning.store(false, Ordering::Release);
    }
}

/// A named participant: publishers and subscriptions belong to a node. Clones are the same node.
#[derive(Clone, Debug)]
pub struct Node {
    context: Context,
    time: NodeTime,
    name: Arc<str>,
    #[allow(dead_code, reason = "held for its end")]
    presence: Presence,
}

impl Node {
    /// The fully qualified name, `/robot/pong`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The context the node lives in.
    #[must_use]
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// A publisher of `M` on `topic`, which is expanded against this node's name
    /// (`scan`, `/scan`, `~/scan`); a [`Topic`] says how large a message may be, too. The memory
    /// for it, and for the messages that its quality of service keeps, is taken here.
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::Parameter`] for a depth of 0 or above [`Qos::MAX_DEPTH`], a size
    /// out of range, and settings of a subscription, [`Error::Middleware`] when it cannot be
    /// created.
    pub fn publisher<'t, M: Message>(
        &self,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
    ) -> Result<Publisher<M>, Error> {
        let asked = topic.into();
        let topic = self.resolve(Kind::Topic, asked.name)?;
        check_depth(&topic, qos)?;
        asked.check_plain("topic", &topic, "of a subscription only")?;
        let (usual, most) = sizes::<M>();
        let usual = usual.min(self.context.middleware().longest(&qos, true));
        let max_size = checked(("topic", &topic), asked.max_size, (usual, most), qos)?;
        let spec = self.endpoint::<M>(&topic, qos, max_size);
        let writer = self
            .context
            .middleware()
            .create_writer(&spec)
            .map_err(|e| Error::endpoint("publisher", &topic, e))?;
        let middleware = self.context.share_middleware();
        Ok(Publisher::new(middleware, writer, topic, max_size))
    }

    #[allow(dead_code, reason = "there is no simulation without feature `std`")]
    pub(crate) fn time(&self) -> NodeTime {
        self.time
    }

    /// `name` is that of `topic` in full.
    pub(crate) fn service<'a, S: Service>(
        &'a self,
        name: &'a str,
        topic: Topic<'_>,
        qos: Qos,
    ) -> Result<ServiceSpec<'a>, Error> {
        let most = largest::<S::Request>().max(largest::<S::Response>());
        let usual = S::Request::MAX_SIZE.max(S::Response::MAX_SIZE);
        checked(("service", name), topic.max_size, (usual, most), qos)?;
        topic.check_plain("service", name, "with topics only")?;
        Ok(ServiceSpec {
            node: &self.name,
            service: name,
            type_name: S::TYPE_NAME,
            request_type: S::Request::DDS_TYPE_NAME,
            response_type: S::Response::DDS_TYPE_NAME,
            type_hash: if STD { S::TYPE_HASH } else { None },
            qos,
            max_request: sized::<S::Request>(topic.max_size),
            max_response: sized::<S::Response>(topic.max_size),
        })
    }

    /// The name of a topic or service that this node calls `given`.
    pub(crate) fn resolve(&self, kind: Kind, given: &str) -> Result<String, Error> {
        self.context.process_args().name(kind, given, &self.name)
    }

    pub(crate) fn endpoint<'a, M: Message>(
        &'a self,
        topic: &'a str,
        qos: Qos,
        max_size: usize,
    ) -> EndpointSpec<'a> {
        EndpointSpec {
            node: &self.name,
            topic,
            type_name: M::TYPE_NAME,
            dds_type_name: M::DDS_TYPE_NAME,
            type_hash: if STD { M::TYPE_HASH } else { None },
            qos,
            max_size,
            ingress: IngressLimit::none(),
            keep_oldest: false,
        }
    }
}

pub(crate) fn check_depth(topic: &str, qos: Qos) -> Result<(), Error> {
    if STD && let Some((field, time)) = qos.too_short() {
        let owner = text!("topic {topic}");
        let value = text!("{time:?}");
        return Err(Error::parameter(
            owner,
            field,
            &value,
            "0, or 1 ms and more",
        ));
    }
    match qos.checked_depth() {
        Some(_) => Ok(()),
        None => Err(Error::parameter(
            text!("topic {topic}"),
            "qos.depth",
            &qos.depth,
            "1..=4096",
        )),
    }
}
