//! The groups that workers share, as the planner needs them: holders and lengths.

use crate::executor::handles::group::Group;
use crate::executor::run::state::WorkerSpec;
use alloc::string::String;
use alloc::vec::Vec;
use core::time::Duration;
use replenish_os::Policy;
use replenish_plan::{Guarantee, Hold};

/// The groups of an executor's handles, by their number in the request.
pub(super) struct SharedGroups(Vec<Known>);

struct Known {
    group: Group,
    /// A real-time worker is in it.
    urgent: bool,
}

impl SharedGroups {
    pub(super) fn of(workers: &[WorkerSpec]) -> Self {
        let mut all: Vec<Known> = Vec::new();
        for spec in workers {
            let asked = &spec.request;
            let time_shared = matches!(asked.policy, None | Some(Policy::Other));
            let urgent = asked.wants().is_some() || !time_shared;
            for group in groups(spec) {
                match all.iter_mut().find(|k| k.group.is(group)) {
                    Some(known) => known.urgent |= urgent,
                    None => all.push(Known {
                        group: group.clone(),
                        urgent,
                    }),
                }
            }
        }
        Self(all)
    }

    pub(super) fn names(&self) -> Vec<String> {
        self.0.iter().map(|k| k.group.name().into()).collect()
    }

    /// Whether a real-time worker may wait for this one.
    pub(super) fn matter(&self, spec: &WorkerSpec) -> bool {
        groups(spec).any(|group| self.0.iter().any(|k| k.urgent && k.group.is(group)))
    }

    pub(super) fn holds(&self, spec: &WorkerSpec) -> Vec<Hold> {
        let entries = spec.entries.iter();
        let hold = entries.filter_map(|entry| {
            let group = entry.handling.group.as_ref()?;
            let lock = self.0.iter().position(|k| k.group.is(group))?;
            let length = Some(group.length()).filter(|l| *l > 0);
            Some(Hold::of(lock, length, &*entry.shared.id))
        });
        hold.collect()
    }

    /// Writes down the lengths that the plan has counted: they are judged, and more is not admitted
    /// later.
    pub(super) fn counted(workers: &mut [WorkerSpec]) {
        for spec in workers {
            let Some(guarantee) = spec.request.wants().filter(Guarantee::is_rate) else {
                continue;
            };
            for entry in &mut spec.entries {
                let group = entry.handling.group.take();
                entry.handling.group = group.map(|group| match group.length() {
                    0 => group.holds(Duration::from_nanos(guarantee.desired())),
                    _ => group,
                });
            }
        }
    }
}

fn groups(spec: &WorkerSpec) -> impl Iterator<Item = &Group> {
    spec.entries
        .iter()
        .filter_map(|e| e.handling.group.as_ref())
}
