//! In the place of [`change`](super) in builds without feature `full`: the handles that were
//! described stay until the end.

pub(crate) mod live {
    //! The state that outlives the set-up: the handles.

    use super::registry::Registry;
    use crate::context::Context;
    use crate::executor::handles::group::Group;
    use crate::executor::run::mailbox::Mailbox;
    use crate::executor::run::route_updates::RouteUpdates;
    use crate::executor::wake::stop::StopHandle;
    use crate::middleware::SourceSet;
    use crate::sync::Arc;
    use alloc::vec::Vec;

    /// The handles.
    pub(crate) struct Live {
        pub(crate) registry: Registry,
    }

    /// A worker needs no way to it.
    pub(crate) struct Post;

    impl Post {
        pub(crate) const fn new(
            _: &Arc<str>,
            _: &Arc<Mailbox>,
            _: &Option<Arc<SourceSet>>,
            _: u64,
            _: bool,
            _: (bool, bool),
        ) -> Self {
            Self
        }
    }

    impl Live {
        pub(crate) fn new(
            _: &Context,
            _: &StopHandle,
            registry: Registry,
            _: &Arc<RouteUpdates>,
            _: Vec<Post>,
            _: &mut dyn Iterator<Item = (&Arc<str>, &Group)>,
        ) -> Arc<Self> {
            Arc::new(Self { registry })
        }

        /// No handle to an executor outlives it, and readers stay.
        #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
        pub(crate) const fn end(&self, _: bool) {}
    }
}

pub(crate) mod registry {
    //! The handles by id.

    use crate::executor::handles::state::HandleState;
    use crate::sync::Arc;
    use alloc::vec::Vec;

    /// Every handle with its worker's name.
    pub(crate) struct Registry(Vec<(Arc<str>, Arc<HandleState>)>);

    impl Registry {
        pub(crate) const fn new(
            handles: Vec<(Arc<str>, Arc<HandleState>)>,
            _: usize,
            _: usize,
        ) -> Self {
            Self(handles)
        }

        pub(crate) fn find(&self, id: &str) -> Option<(Arc<str>, Arc<HandleState>)> {
            self.0.iter().find(|(_, h)| h.id == id).cloned()
        }

        pub(crate) fn all(&self) -> Vec<(Arc<str>, Arc<HandleState>)> {
            self.0.clone()
        }
    }
}
