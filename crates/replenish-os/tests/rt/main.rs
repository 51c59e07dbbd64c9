//! Policies, threads, locks and budgets in force: trials that need real-time priority, one after
//! another. On the NuttX back end (`tools/nuttx-host`) fewer apply, and some apply there alone.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

#[cfg(not(nuttx_host))]
mod change_user;
mod common;
mod enforcer;
#[cfg(not(nuttx_host))]
mod foreign;
#[cfg(not(nuttx_host))]
mod foreign_own;
#[cfg(not(nuttx_host))]
mod migration;
#[cfg(nuttx_host)]
mod nuttx;
mod pi_mutex;
#[cfg(not(nuttx_host))]
mod refused;
#[cfg(not(nuttx_host))]
mod sched;
#[cfg(not(nuttx_host))]
mod supervision;
#[cfg(not(nuttx_host))]
mod suspend;
#[cfg(not(nuttx_host))]
mod switches;
#[cfg(not(nuttx_host))]
mod thread;
#[cfg(not(nuttx_host))]
mod unprivileged;

use replenish_testkit::harness::run_in_turn;

#[cfg(nuttx_host)]
fn main() {
    run_in_turn([
        ("enforcer", enforcer::trials()),
        ("nuttx", nuttx::trials()),
        ("pi_mutex", pi_mutex::trials()),
    ])
}

#[cfg(not(nuttx_host))]
fn main() {
    if unprivileged::is_child() {
        unprivileged::child();
    }
    if supervision::is_child() {
        supervision::child();
    }
    if change_user::is_child() {
        change_user::child();
    }
    if refused::is_child() {
        refused::child();
    }
    if foreign::is_child() {
        foreign::child();
    }
    run_in_turn([
        ("change_user", change_user::trials()),
        ("enforcer", enforcer::trials()),
        ("foreign", foreign::trials()),
        ("foreign_own", foreign_own::trials()),
        ("migration", migration::trials()),
        ("pi_mutex", pi_mutex::trials()),
        ("refused", refused::trials()),
        ("sched", sched::trials()),
        ("suspend", suspend::trials()),
        ("supervision", supervision::trials()),
        ("switches", switches::trials()),
        ("thread", thread::trials()),
    ])
}
