//! A worker's state with its name and budget, which rclrs carries to the runtime as the payload.
//!
//! rclrs hands the payload over as a value of an unknown type. Each type of payload that was made
//! leaves a function here that finds the name and the budget in it.

use replenish_threads::{
    self as threads, Asked, Failure, Guarantee, Policy, Report, Requirement, SchedClass, Why,
};
use std::any::{Any, TypeId};
use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// A worker's state, with its name and, if it has one, its budget.
///
/// Callbacks use it like the state. The budget ends with it.
#[derive(Debug)]
pub struct Budgeted<T> {
    name: String,
    budget: Option<u64>,
    state: T,
}

/// Parts of a payload that the runtime needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Found {
    pub(crate) name: String,
    pub(crate) budget: Option<u64>,
}

type Finder = fn(&dyn Any) -> Option<Found>;

/// One function for each type of state in the program.
static FINDERS: Mutex<BTreeMap<TypeId, Finder>> = Mutex::new(BTreeMap::new());

pub(crate) fn find(payload: &dyn Any) -> Option<Found> {
    let finders = FINDERS.lock().unwrap_or_else(PoisonError::into_inner);
    finders.get(&payload.type_id())?(payload)
}

/// All budgets of this process so far, in the order in which they were made.
#[must_use]
pub fn reports() -> Vec<Report> {
    let all = threads::list().unwrap_or_default();
    // One that ends meanwhile is left out.
    all.into_iter()
        .filter_map(|budget| threads::report(budget).ok())
        .collect()
}

/// Begins a worker's payload: its name, of 1 to 31 bytes, and its state.
///
/// The name is the thread's, cut after 15 bytes, and the budget's in reports, refusals and the
/// deployment file.
pub fn worker<T: 'static + Send + Sync>(name: &str, state: T) -> WorkerBuilder<T> {
    WorkerBuilder {
        asked: Asked {
            name: name.into(),
            scheduling: None,
            cpu: None,
            background: SchedClass::Other,
        },
        state,
    }
}

/// A worker's payload that is not admitted yet.
#[derive(Debug)]
#[must_use = "a worker needs .admit()"]
pub struct WorkerBuilder<T> {
    asked: Asked,
    state: T,
}

impl<T: 'static + Send + Sync> WorkerBuilder<T> {
    /// Guarantees a [`Budget`](crate::Budget), or a [`Guarantee`] that says more. Priority and CPU
    /// are the plan's choice.
    pub fn budget(mut self, guarantee: impl Into<Guarantee>) -> Self {
        self.asked.scheduling = Some(Requirement::Guarantee(guarantee.into()));
        self
    }

    /// An expert's sporadic policy, in place of a guarantee.
    pub fn policy(mut self, policy: Policy) -> Self {
        self.asked.scheduling = Some(Requirement::Policy(policy));
        self
    }

    /// The CPU of its thread while it has the budget.
    pub fn cpu(mut self, cpu: usize) -> Self {
        self.asked.cpu = Some(cpu);
        self
    }

    /// Its thread without budget: an ordinary one (the default), `SCHED_IDLE`, or a FIFO priority
    /// below the budget's.
    pub fn background(mut self, background: SchedClass) -> Self {
        self.asked.background = background;
        self
    }

    /// The payload, if its budget fits beside everything that was promised on this host.
    ///
    /// A worker without budget has an ordinary thread, unless the file that `REPLENISH_OVERLAY`
    /// names has a `[[worker]]` of its name: that file's word counts before the program's.
    ///
    /// # Errors
    /// The refusal, which says what would fit; a value out of its range; a missing privilege.
    pub fn admit(self) -> Result<Budgeted<T>, Failure> {
        let Self { asked, state } = self;
        let name = asked.name.clone();
        let length = name.len();
        if !(1..=31).contains(&length) || name.contains(char::is_control) {
            return Err(Failure::invalid(format!(
                "worker name {name:?} is out of range: 1 to 31 bytes without control characters"
            )));
        }
        if let Some(Requirement::Guarantee(guarantee)) = &asked.scheduling
            && guarantee.budget().suspend
        {
            return Err(Failure::new(
                Why::Unsupported,
                format!(
                    "worker {name:?}: a thread that runs rclrs cannot be suspended, it could hold a \
                     lock; say .background(SchedClass::Idle)"
                ),
            ));
        }
        let unasked = asked.scheduling.is_none();
        let budget = match threads::new(asked) {
            Ok(budget) => Some(budget),
            Err(failure) if unasked && failure.why == Why::NotFound => None,
            Err(failure) => return Err(failure),
        };
        let mut finders = FINDERS.lock().unwrap_or_else(PoisonError::into_inner);
        finders.insert(TypeId::of::<Budgeted<T>>(), |payload| {
            let payload = payload.downcast_ref::<Budgeted<T>>()?;
            Some(Found {
                name: payload.name.clone(),
                budget: payload.budget,
            })
        });
        Ok(Budgeted {
            name,
            budget,
            state,
        })
    }
}

impl<T> Budgeted<T> {
    /// The worker's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The budget so far; `None` for a worker that has none.
    #[must_use]
    pub fn report(&self) -> Option<Report> {
        threads::report(self.budget?).ok()
    }
}

impl<T> Deref for Budgeted<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.state
    }
}

impl<T> DerefMut for Budgeted<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.state
    }
}

impl<T> Drop for Budgeted<T> {
    fn drop(&mut self) {
        if let Some(budget) = self.budget {
            threads::release(budget).ok(); // fails only where it has ended already
        }
    }
}
