//! Guarantees, in builds with feature `plan`.

pub(crate) use replenish_plan::Guarantee;
