//! Clients of services, made by their node.

use super::client::Client;
use crate::context::{Node, check_depth};
use crate::error::Error;
use crate::executor::Topic;
use crate::handoff::{Inbox, Keep};
use crate::platform::text;
use crate::process::Kind;
use crate::qos::Qos;
use core::time::Duration;
use replenish_msg::Service;

impl Node {
    /// A client of the service `name`, which is expanded as topics are; a [`Topic`] says more, the
    /// largest size of requests and responses with unbounded fields. Each request may take
    /// `limit` until its reply, and `qos.depth` requests may wait for theirs at a time. Replies
    /// come to [`WorkerBuilder::replies`](crate::WorkerBuilder::replies).
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::Parameter`] for a depth or size out of range and a limit of 0,
    /// [`Error::Middleware`] when it cannot be created.
    pub fn client<'t, S: Service>(
        &self,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        limit: Duration,
    ) -> Result<Client<S>, Error> {
        let topic = name.into();
        let name = self.resolve(Kind::Service, topic.name)?;
        check_depth(&name, qos)?;
        if limit == Duration::ZERO {
            let owner = text!("service {name}");
            return Err(Error::parameter(owner, "limit", &0, "1 ns or more"));
        }
        let middleware = self.context().middleware();
        let spec = self.service::<S>(&name, topic, qos)?;
        let ends = middleware
            .create_client(&spec)
            .map_err(|e| Error::endpoint("client", &name, e))?;
        let inbox = Inbox::new(qos.depth.into(), spec.max_response, Keep::Newest);
        let middleware = self.context().share_middleware();
        let (node, most) = (self.name().into(), qos.depth.into());
        let size = spec.max_request;
        Ok(Client::new(
            middleware, ends, inbox, node, name, limit, most, size,
        ))
    }
}
