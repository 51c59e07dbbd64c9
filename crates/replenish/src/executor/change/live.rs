//! The state that every handle to a running executor shares.

use super::groups::{Groups, Member};
use super::registry::Registry;
use crate::Nanos;
use crate::context::Context;
use crate::error::Error;
use crate::executor::handles::group::Group;
use crate::executor::run::mailbox::Mailbox;
use crate::executor::run::route_updates::RouteUpdates;
use crate::executor::wake::stop::StopHandle;
use crate::middleware::SourceSet;
use crate::platform::text;
use crate::sync::{Arc, AtomicU64, Mutex};
use alloc::vec::Vec;

/// One worker as it is seen from outside.
pub(crate) struct Post {
    pub(crate) name: Arc<str>,
    pub(crate) mailbox: Arc<Mailbox>,
    /// The descriptors that it waits for.
    pub(super) sources: Option<Arc<SourceSet>>,
    /// Numbers for the ids of timers and guard conditions.
    pub(crate) number: AtomicU64,
    /// Its rounds begin by the clock.
    pub(super) clocked: bool,
    /// It is real-time.
    urgent: bool,
    /// Its guarantee was admitted.
    promised: bool,
}

/// The state that all handles to a running executor share.
pub(crate) struct Live {
    pub(crate) context: Context,
    pub(crate) stop: StopHandle,
    pub(crate) registry: Registry,
    pub(crate) updates: Arc<RouteUpdates>,
    pub(crate) posts: Vec<Post>,
    pub(super) groups: Groups,
    /// By worker: the worker that its callback waits for.
    awaited: Mutex<Vec<Option<usize>>>,
}

impl Post {
    pub(crate) fn new(
        name: &Arc<str>,
        mailbox: &Arc<Mailbox>,
        sources: &Option<Arc<SourceSet>>,
        number: u64,
        clocked: bool,
        (urgent, promised): (bool, bool),
    ) -> Self {
        Self {
            name: Arc::clone(name),
            mailbox: Arc::clone(mailbox),
            sources: sources.clone(),
            number: AtomicU64::new(number),
            clocked,
            urgent,
            promised,
        }
    }

    /// Whether its guarantee was admitted.
    #[allow(dead_code, reason = "diagnostics need feature `std`")]
    pub(crate) const fn is_promised(&self) -> bool {
        self.promised
    }

    fn member(&self, counted: Nanos) -> Member {
        Member {
            worker: Arc::clone(&self.name),
            urgent: self.urgent,
            counted,
        }
    }
}

impl Live {
    pub(crate) fn new(
        context: &Context,
        stop: &StopHandle,
        registry: Registry,
        updates: &Arc<RouteUpdates>,
        posts: Vec<Post>,
        known: &mut dyn Iterator<Item = (&Arc<str>, &Group)>,
    ) -> Arc<Self> {
        let groups = Groups::default();
        for (worker, group) in known {
            let post = posts.iter().find(|p| p.name == *worker);
            // Admission has judged already: nothing new is promised here.
            post.map(|p| groups.join(group, p.member(group.length()), false).ok());
        }
        Arc::new(Self {
            context: context.clone(),
            stop: stop.clone(),
            registry,
            updates: Arc::clone(updates),
            awaited: Mutex::new(alloc::vec![None; posts.len()]),
            posts,
            groups,
        })
    }

    /// Whether the caller may wait for the worker at `target`: not in a callback of its own, not in
    /// one of a group, which that worker may wait for, not in a hook on the dispatcher's thread,
    /// for which all wait, and not if that worker waits for the caller's, directly or not. The
    /// place of the caller's worker, if it is one; it waits from now on.
    pub(super) fn may_await(&self, target: usize) -> Result<Option<usize>, ()> {
        let is_mine = |post: &Post| post.mailbox.is_mine();
        let own = self.posts.get(target).is_some_and(is_mine);
        if own || self.groups.has_mine() || self.updates.is_mine() {
            return Err(());
        }
        let Some(me) = self.posts.iter().position(is_mine) else {
            return Ok(None); // nobody waits for a thread that is no worker
        };
        let mut awaited = self.awaited.lock();
        let mut next = Some(target);
        while let Some(at) = next {
            if at == me {
                return Err(());
            }
            next = awaited.get(at).copied().flatten();
        }
        if let Some(place) = awaited.get_mut(me) {
            *place = Some(target);
        }
        Ok(Some(me))
    }

    /// Lets a handle of this worker join the group, unless a worker with a guarantee would wait
    /// longer.
    pub(super) fn join(&self, post: &Post, group: &Group) -> Result<(), Error> {
        let promised = self.posts.iter().any(|p| p.promised);
        let joined = self.groups.join(group, post.member(0), promised);
        joined.map_err(|other| Error::NotAdmitted {
            reason: text!(
                "a handle of worker {:?} cannot join group {:?} while the executor runs: worker {other:?} is in it, and the plan does not count that either waits for the other so long; describe the handle before the start, or state a shorter time (Group::holds)",
                &*post.name,
                group.name()
            ),
        })
    }

    /// The executor has ended, and a handle to it may stay: what waits in its inboxes, and what
    /// still comes, goes back to the publishers. Its readers go, unless a dispatcher that does not
    /// end may still be in the middleware.
    pub(crate) fn end(&self, is_dispatched: bool) {
        let middleware = &**self.context.middleware();
        let handles = self.registry.all();
        for (_, handle) in &handles {
            handle.discard(true, middleware);
            if let Some((reader, _)) = handle.input.as_ref().filter(|_| !is_dispatched) {
                // A middleware that cannot do it keeps the reader.
                middleware.delete_reader(*reader).ok();
            }
        }
    }

    /// Notes that the worker does not wait for another one any more.
    pub(super) fn has_awaited(&self, me: Option<usize>) {
        let mut awaited = self.awaited.lock();
        if let Some(place) = me.and_then(|me| awaited.get_mut(me)) {
            *place = None;
        }
    }
}
