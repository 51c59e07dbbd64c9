//! The groups of an executor's handles: which handle may join one while it runs, and that a
//! callback in a group must not wait for another worker.

use crate::Nanos;
use crate::executor::handles::group::Group;
use crate::sync::{Arc, Mutex};
use alloc::vec::Vec;
use replenish_os::current_tid;

/// A worker of which a handle is in a group.
pub(crate) struct Member {
    pub(crate) worker: Arc<str>,
    /// It is real-time.
    pub(crate) urgent: bool,
    /// The longest callback that admission has counted; 0: none.
    pub(crate) counted: Nanos,
}

/// The groups of an executor's handles, with the workers that these are on.
#[derive(Default)]
pub(crate) struct Groups(Mutex<Vec<(Group, Vec<Member>)>>);

impl Groups {
    /// Enters a worker into the group, for a handle that is about to come. The error is a worker
    /// that would have to wait longer for it than admission has promised. Forgets groups that no
    /// handle has any more. Allocates.
    pub(crate) fn join(
        &self,
        group: &Group,
        member: Member,
        promised: bool,
    ) -> Result<(), Arc<str>> {
        let mut known = self.0.lock();
        known.retain(|(g, _)| Arc::strong_count(&g.inner) > 1);
        let at = known.iter().position(|(g, _)| g.is(group));
        let at = at.unwrap_or_else(|| {
            known.push((group.clone(), Vec::new()));
            known.len() - 1
        });
        let Some((_, members)) = known.get_mut(at) else {
            return Ok(());
        };
        let mut own = members.iter().filter(|m| m.worker == member.worker);
        let counted = own.any(|m| group.length() != 0 && group.length() <= m.counted);
        let mut others = members.iter().filter(|m| m.worker != member.worker);
        let other = others.find(|m| m.urgent || member.urgent);
        match other {
            Some(other) if promised && !counted => Err(Arc::clone(&other.worker)),
            _ => {
                match members.iter_mut().find(|m| m.worker == member.worker) {
                    Some(known) => known.counted = known.counted.max(member.counted),
                    None => members.push(member),
                }
                Ok(())
            }
        }
    }

    /// Whether the caller is inside a callback of one of them.
    pub(crate) fn has_mine(&self) -> bool {
        self.0.lock().iter().any(|(group, _)| group.is_mine())
    }
}

impl Group {
    /// Whether both are the same group.
    pub(crate) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.inner, &other.inner)
    }

    /// Whether the caller is inside a callback of the group.
    pub(crate) fn is_mine(&self) -> bool {
        let me = current_tid();
        let holder = self.inner.holder.lock();
        holder.as_ref().is_some_and(|(tid, _)| *tid == me)
    }
}
