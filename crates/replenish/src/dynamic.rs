//! Services of parameters and managed nodes on workers that run.

use crate::bare::{Bare, Body, Serves, Unanswered, answers};
use crate::context::Node;
use crate::error::Error;
use crate::executor::{CallbackContext, HandleGroup, Responder, Topic, WorkerHandle};
use crate::lifecycle::{self, Lifecycle};
use crate::parameter::{self, Parameters};
use crate::qos::Qos;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_msg::{CdrWriter, Service};

impl WorkerHandle<'_> {
    /// Serves a node's parameters, as
    /// [`WorkerBuilder::parameters`](crate::WorkerBuilder::parameters) does; the ids of the six
    /// handles.
    ///
    /// # Errors
    /// Those of this type; nothing was added then.
    pub fn parameters(self, parameters: &Parameters) -> Result<Vec<String>, Error> {
        Ok(parameter::services::serve(HandleGroup::to(&self), parameters)?.done())
    }
}

impl WorkerHandle<'_> {
    /// Lets others ask for transitions, as
    /// [`WorkerBuilder::lifecycle`](crate::WorkerBuilder::lifecycle) does; the ids of the five
    /// handles.
    ///
    /// # Errors
    /// Those of this type; nothing was added then.
    pub fn lifecycle(self, lifecycle: &Lifecycle) -> Result<Vec<String>, Error> {
        Ok(lifecycle::services::serve(HandleGroup::to(&self), lifecycle)?.done())
    }
}

impl Serves for HandleGroup<'_> {
    fn serve_bytes<S: Service>(
        mut self,
        node: &Node,
        name: Topic<'_>,
        answer: impl FnMut(&[u8], &mut CdrWriter<'_>) -> Result<(), Unanswered> + Send + 'static,
    ) -> Result<Self, Error> {
        let mut answer = answers::<S, _>(name, answer);
        let called =
            move |request: &Body<S::Request>, to: Responder<Bare<S>>, _: &CallbackContext<'_>| {
                answer(request.payload(), to)
            };
        let (worker, qos) = (self.worker(), Qos::services());
        let id = worker.serve_later::<Bare<S>, _, _>(node, name, qos, called);
        self.keep(id)?;
        Ok(self)
    }
}
