//! The budgets of an enforcer, under its lock.

use super::error::ForeignError;
use super::group::{Event, Group};
use super::member::Member;
use super::usage::BudgetId;
use crate::enforcer::alarm::Alarm;
use crate::{EnforcerStats, Tid};

/// Budgets of one enforcer at most.
pub(super) const MOST_BUDGETS: usize = 64;

#[derive(Debug)]
pub(super) struct Groups {
    pub(super) budgets: Vec<Group>,
    pub(super) events: Vec<Event>,
    pub(super) alarm: Alarm,
    pub(super) stats: EnforcerStats,
}

impl Groups {
    /// Takes in a budget: in the place of a retired one, which is returned, or behind the others.
    pub(super) fn add(&mut self, group: Group) -> Result<(usize, Option<Group>), ForeignError> {
        let retired = |(_, old): &(usize, &mut Group)| old.retired;
        if let Some((place, old)) = self.budgets.iter_mut().enumerate().find(retired) {
            return Ok((place, Some(std::mem::replace(old, group))));
        }
        let place = self.budgets.len();
        if place == MOST_BUDGETS {
            return Err(ForeignError::Full {
                what: "budgets",
                capacity: MOST_BUDGETS,
            });
        }
        self.budgets.push(group);
        Ok((place, None))
    }

    pub(super) fn has(&self, tid: Tid) -> bool {
        let mut members = self.budgets.iter().flat_map(|group| &group.members);
        members.any(|member| member.thread.tid() == tid && !member.ended)
    }

    pub(super) fn any(&self) -> Option<Tid> {
        let member = self
            .budgets
            .iter()
            .find_map(|group| group.members.first())?;
        Some(member.thread.tid())
    }

    pub(super) fn take(&mut self, tid: Tid) -> Option<(Member, BudgetId)> {
        let mut budgets = self.budgets.iter_mut().enumerate();
        budgets.find_map(|(place, group)| Some((group.take(tid)?, BudgetId(place))))
    }
}
