//! Guarantees, in builds with feature `plan`: of workers, and of threads that others have started
//! (`adoption`).

pub(crate) mod adoption;

pub use adoption::AdoptedReport;
pub(crate) use replenish_plan::Guarantee;
