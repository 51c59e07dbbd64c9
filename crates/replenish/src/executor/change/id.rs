//! The id of a handle as a value that a program keeps, to remove the handle later.

use crate::executor::describe::builder::WorkerBuilder;
use crate::sync::Arc;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::ops::Deref;

/// The id of a handle, from [`WorkerBuilder::added_ids`] or from the
/// [`WorkerHandle`](crate::WorkerHandle) that added it. A clone does not allocate.
///
/// It is the text of the [report](crate::Report) and of deployment files, `/arm/sub:/t`, and serves
/// wherever an id is asked for. It does not keep the handle: a handle that has been removed is an
/// [`Error::UnknownHandle`](crate::Error::UnknownHandle), and a later one of the same text has the
/// same id.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct HandleId(Arc<str>);

impl WorkerBuilder<'_> {
    /// The ids of [`added`](Self::added), to be kept when the description has ended.
    ///
    /// ```
    /// # use replenish::{Context, Error, Executor, Removal};
    /// # use std::time::Duration;
    /// # fn main() -> Result<(), Error> {
    /// # let ctx = Context::in_process();
    /// # let mut exec = Executor::new(&ctx);
    /// let worker = exec.worker("w").timer(Duration::from_millis(1), |_| ())?;
    /// let ids = worker.added_ids();
    /// let running = exec.start()?;
    /// for id in &ids {
    ///     running.handle().remove(id, Removal::Detach)?;
    /// }
    /// assert!(running.stats(&ids[0]).is_none());
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn added_ids(&self) -> Vec<HandleId> {
        self.added().map(HandleId::from).collect()
    }
}

impl HandleId {
    /// Its text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Deref for HandleId {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl AsRef<str> for HandleId {
    fn as_ref(&self) -> &str {
        &self.0
    }
}

impl From<&str> for HandleId {
    fn from(id: &str) -> Self {
        Self(id.into())
    }
}

impl From<HandleId> for String {
    fn from(id: HandleId) -> Self {
        (*id.0).into()
    }
}

impl PartialEq<str> for HandleId {
    fn eq(&self, other: &str) -> bool {
        *self.0 == *other
    }
}

impl PartialEq<&str> for HandleId {
    fn eq(&self, other: &&str) -> bool {
        *self.0 == **other
    }
}

impl PartialEq<String> for HandleId {
    fn eq(&self, other: &String) -> bool {
        *self.0 == **other
    }
}

impl fmt::Display for HandleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl fmt::Debug for HandleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&*self.0, f)
    }
}
