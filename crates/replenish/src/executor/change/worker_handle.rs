//! A worker of a running executor, to which any thread adds handles.

use super::handle::{ExecutorHandle, Removal};
use super::id::HandleId;
use super::live::{Live, Post};
use super::registry::Claims;
use crate::error::Error;
use crate::executor::describe::add::{AddHandles, Numbering, Target};
use crate::executor::describe::factory::HandleFactory;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::options::HandleOptions;
use crate::executor::handles::own_source::OwnSource;
use crate::executor::run::mailbox::Command;
use crate::executor::run::routes::Route;
use crate::handoff::{Declined, Inbox};
use crate::middleware::ReaderId;
use crate::platform::text;
use crate::sync::{Arc, Ordering};
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::fmt;

/// A worker of a running executor. Each method adds one handle and returns its id, or the ids of
/// the handles that belong together.
///
/// # Errors
/// Besides those that each method names: [`Error::Capacity`] with the limit when the worker is full
/// (see [`WorkerBuilder::capacity`](crate::WorkerBuilder::capacity)), [`Error::Stopped`], and
/// [`Error::NotAdmitted`] for a handle in a [group](crate::Group) where a guaranteed worker would
/// wait longer than the plan says.
pub type WorkerHandle<'e> = AddHandles<Running<'e>>;

/// One worker of an executor that runs.
pub struct Running<'e> {
    live: &'e Arc<Live>,
    post: &'e Post,
    options: HandleOptions,
}

/// Handles that belong together, of a worker that runs; if one cannot be added, the others are
/// removed.
pub struct HandleGroup<'e> {
    worker: Running<'e>,
    ids: Vec<HandleId>,
    /// All options apply to the next handle.
    last: bool,
}

impl fmt::Debug for WorkerHandle<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WorkerHandle")
            .field("name", &self.0.post.name)
            .finish_non_exhaustive()
    }
}

impl ExecutorHandle {
    /// A worker of this name, to add handles to.
    ///
    /// # Errors
    /// [`Error::UnknownWorker`].
    pub fn worker(&self, name: &str) -> Result<WorkerHandle<'_>, Error> {
        let mut posts = self.live.posts.iter();
        let post = posts.find(|p| &*p.name == name);
        let post = post.ok_or_else(|| Error::UnknownWorker(name.into()))?;
        Ok(AddHandles(Running {
            live: &self.live,
            post,
            options: HandleOptions::new(),
        }))
    }
}

impl<'e> WorkerHandle<'e> {
    /// The executor, and its worker.
    pub(super) fn place(self) -> (&'e Arc<Live>, &'e Post) {
        (self.0.live, self.0.post)
    }
}

impl WorkerHandle<'_> {
    /// Options of the handle that is added next. Where several are added together (actions,
    /// parameters, managed nodes), priority, group and error hook apply to all of them.
    #[must_use]
    pub fn options(self, options: HandleOptions) -> Self {
        Self(Running { options, ..self.0 })
    }
}

impl<'e> Target for Running<'e> {
    type Added = HandleId;
    type AllAdded = Vec<HandleId>;
    type Together = HandleGroup<'e>;

    fn add(
        self,
        _: Numbering,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<HandleId, Error> {
        let Self {
            live,
            post,
            options,
        } = self;
        if let Some(group) = &options.group {
            live.join(post, group)?;
        }
        post.mailbox.free_retired();
        let update = live.updates.reserve()?;
        let reserved = post.mailbox.reserve().map_err(|e| declined(e, post))?;
        let number = post.number.fetch_add(1, Ordering::Relaxed);
        let claims = Claims::of(&live.registry);
        let mut entry = make(&HandleFactory {
            context: &live.context,
            worker: &post.name,
            unique: &|id| claims.unique(id),
            number: usize::try_from(number).unwrap_or(usize::MAX),
        })?;
        entry.treat(options);
        entry.slot = reserved.slot();
        if let Some(set) = &post.sources {
            let middleware = &**live.context.middleware();
            entry.own = OwnSource::of(&entry.shared, middleware, set, entry.slot);
        }
        let shared = Arc::clone(&entry.shared);
        let wake = post.mailbox.wake_handle(entry.slot);
        let route = Route::new(Arc::clone(&shared), wake);
        let sent = live.registry.enter(&post.name, &shared, || {
            post.mailbox.add(reserved, entry)?;
            if let Some((reader, _)) = shared.input {
                update.update(reader, Some(route));
            }
            Ok(())
        });
        sent.map_err(|_: Box<Command>| Error::Stopped)?;
        if shared.input.is_some() {
            live.context.middleware().wake();
        }
        Ok(HandleId::from(shared.id.as_str()))
    }

    fn together(self) -> HandleGroup<'e> {
        let ids = Vec::new();
        HandleGroup {
            worker: self,
            ids,
            last: false,
        }
    }

    fn all_added(self, _: u8) -> Vec<HandleId> {
        Vec::new()
    }

    fn last_inbox(&mut self) -> Option<Arc<Inbox>> {
        None
    }

    fn reader_of(&mut self, id: &str) -> Option<ReaderId> {
        let (_, shared) = self.live.registry.find(id)?;
        shared.input.as_ref().map(|(reader, _)| *reader)
    }
}

impl Target for HandleGroup<'_> {
    type Added = AddHandles<Self>;
    type AllAdded = Vec<HandleId>;
    type Together = Self;

    fn add(
        mut self,
        numbering: Numbering,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<Self::Added, Error> {
        let Running { live, post, .. } = self.worker;
        let options = if self.last {
            core::mem::take(&mut self.worker.options)
        } else {
            self.worker.options.shared()
        };
        let one = Running {
            live,
            post,
            options,
        };
        self.ids.push(one.add(numbering, make)?);
        Ok(AddHandles(self))
    }

    fn next_is_last(&mut self) {
        self.last = true;
    }

    fn together(self) -> Self {
        self
    }

    fn all_added(mut self, _: u8) -> Vec<HandleId> {
        core::mem::take(&mut self.ids)
    }

    fn last_inbox(&mut self) -> Option<Arc<Inbox>> {
        let (_, shared) = self.worker.live.registry.find(self.ids.last()?)?;
        shared.input.as_ref().map(|(_, inbox)| Arc::clone(inbox))
    }

    fn reader_of(&mut self, id: &str) -> Option<ReaderId> {
        self.worker.reader_of(id)
    }
}

impl Drop for HandleGroup<'_> {
    fn drop(&mut self) {
        let live = Arc::clone(self.worker.live);
        let executor = ExecutorHandle { live };
        for id in &self.ids {
            // A handle that another thread has removed meanwhile is gone as well.
            executor.remove(id, Removal::Detach).ok();
        }
    }
}

fn declined(why: Declined, post: &Post) -> Error {
    match why {
        Declined::Closed => Error::Stopped,
        Declined::Full { limit } => Error::Capacity {
            what: text!("handles of worker {:?}", post.name),
            limit,
        },
    }
}
