//! Trials that need real-time priority, or a process with nothing else in it: one after another.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[path = "../common/mod.rs"]
mod common;

mod admission;
mod adopted;
mod drops;
mod enforcement;
mod groups_admitted;
mod idle;
mod paper_defects;
mod real_time;
mod records;
mod suspended;
mod unprivileged;
mod xrce_executor;

fn main() {
    if admission::child() || records::child() || unprivileged::child() {
        return;
    }
    replenish_testkit::harness::run_in_turn([
        ("admission", admission::trials()),
        ("adopted", adopted::trials()),
        ("drops", drops::trials()),
        ("enforcement", enforcement::trials()),
        ("groups_admitted", groups_admitted::trials()),
        ("idle", idle::trials()),
        ("paper_defects", paper_defects::trials()),
        ("real_time", real_time::trials()),
        ("records", records::trials()),
        ("suspended", suspended::trials()),
        ("unprivileged", unprivileged::trials()),
        ("xrce_executor", xrce_executor::trials()),
    ])
}
