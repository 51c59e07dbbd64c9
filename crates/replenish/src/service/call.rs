//! Requests whose replies are awaited, on a worker or on a thread that is none.

use super::block::block_on;
use super::calls::Calls;
use super::client::Client;
use super::error::{CallError, NoReply};
use crate::error::Error;
use crate::executor::{AddHandles, CallbackContext, Numbering, Target};
use crate::sync::Arc;
use core::fmt;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use core::time::Duration;
use replenish_msg::{CdrError, Service};

/// A request whose reply can be awaited: see [`Client::call_async`].
///
/// Dropping it gives the reply up, and makes room for another request; the server goes on.
#[must_use = "the request is sent; its reply is here"]
pub struct Call<S: Service> {
    client: Client<S>,
    /// Its place, until its outcome was taken.
    at: Result<usize, CallError>,
}

impl<S: Service> Future for Call<S> {
    type Output = Result<S::Response, CallError>;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let polled = match (self.client.calls(), self.at) {
            (_, Err(e)) => Poll::Ready(Err(e)),
            (None, _) => Poll::Ready(Err(CallError::NoCallback)),
            (Some(calls), Ok(at)) => calls.poll(at, cx.waker()),
        };
        if polled.is_ready() {
            self.at = Err(CallError::Gone); // its place may be another call's
        }
        polled
    }
}

impl<S: Service> Drop for Call<S> {
    fn drop(&mut self) {
        if let (Some(calls), Ok(at)) = (self.client.calls(), self.at) {
            calls.give_up(at, |number| self.client.give_up(number));
        }
    }
}

impl<S: Service> fmt::Debug for Call<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Call")
            .field("failed", &self.at.err())
            .finish_non_exhaustive()
    }
}

impl<S: Service> Client<S> {
    /// Sends a request, whose reply is then awaited: `client.call_async(&request).await`. The
    /// client belongs to a worker: [`WorkerBuilder::calls`](crate::WorkerBuilder::calls). Does not
    /// allocate.
    ///
    /// The future gives the response; or [`CallError::NoReply`] if none has come within the
    /// client's limit, [`CallError::Gone`] if its worker ends first, and the errors of
    /// [`call`](Self::call). [`CallError::TooMany`] counts replies that were not taken, too.
    pub fn call_async(&self, request: &S::Request) -> Call<S> {
        self.call_async_with(|room| replenish_msg::encode(request, room))
    }

    /// As [`call_async`](Self::call_async), with a request that `encode` writes.
    pub(crate) fn call_async_with(
        &self,
        encode: impl FnOnce(&mut [u8]) -> Result<usize, CdrError>,
    ) -> Call<S> {
        let at = match self.calls() {
            None => Err(CallError::NoCallback),
            Some(calls) => calls.begin(|| self.call_with(encode)),
        };
        Call {
            client: self.clone(),
            at,
        }
    }

    /// Sends a request and waits for its reply, up to `limit`: for threads that are no worker's, at
    /// set-up or beside the executor, which runs meanwhile. On the worker that takes the client's
    /// replies it waits in vain, until `limit`.
    ///
    /// # Errors
    /// As [`call_async`](Self::call_async) gives; [`NoReply::TimedOut`] after `limit`, too.
    pub fn call_blocking(
        &self,
        request: &S::Request,
        limit: Duration,
    ) -> Result<S::Response, CallError> {
        let late = CallError::NoReply(NoReply::TimedOut);
        block_on(self.call_async(request), limit).unwrap_or(Err(late))
    }
}

/// In the callback for replies, which is dropped when none will come any more.
struct Closes<S: Service>(Arc<Calls<S>>);

impl<S: Service> Drop for Closes<S> {
    fn drop(&mut self) {
        self.0.close();
    }
}

impl<T: Target> AddHandles<T> {
    /// Takes the replies of `client` on this worker, for [`Client::call_async`] and
    /// [`Client::call_blocking`], in the place of [`replies`](Self::replies). Any worker may await
    /// them. Makes room now for as many replies as the depth of the client's quality.
    ///
    /// # Errors
    /// As `replies`.
    pub fn calls<S: Service>(self, client: &Client<S>) -> Result<T::Added, Error> {
        self.0.add(Numbering::None, |factory| {
            let calls = Arc::new(Calls::new(client.most()));
            let closes = Closes(Arc::clone(&calls));
            let settle = move |reply: Result<&mut S::Response, NoReply>,
                               cx: &CallbackContext<'_>| {
                closes.0.settle(cx.request().number(), reply);
            };
            let entry = factory.replies(client, settle)?;
            client.set_calls(calls); // it has belonged to no callback yet
            Ok(entry)
        })
    }
}
