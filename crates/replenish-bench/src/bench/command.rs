//! `replenish bench …`: which benchmark.

use super::{
    dispatch, enforcement, foreign, handoff, in_process, load, recorder, ros2, round_trip, secure,
    soak, torture, xrce,
};
use replenish_cli::outcome::Outcome;

/// A benchmark with its options.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Bench {
    /// Overruns of budgets, against a POSIX CPU timer.
    Enforcement(enforcement::Args),
    /// Waking a worker, against a bare futex.
    Handoff(handoff::Args),
    /// A message to several workers of one process: lent, or encoded.
    InProcess(in_process::Args),
    /// The reliable streams over links that lose datagrams, in virtual time.
    Xrce(xrce::Args),
    /// ROS 2 without an agent, against raw UDP, Cyclone DDS, and rcl with Fast DDS.
    Ros2(ros2::Args),
    /// Client to agent to client, against a raw UDP echo.
    RoundTrip(round_trip::Args),
    /// The same over DTLS and TLS, against UDP and TCP in the clear.
    Secure(secure::Args),
    /// Many clients with many topics on real sockets, through one agent process.
    Load(load::Args),
    /// The cost of bringing a message to its callback, for one handle and for a thousand.
    Dispatch(dispatch::Args),
    /// Budgets for programs that know nothing of them.
    #[command(subcommand)]
    Foreign(foreign::Foreign),
    /// The flight recorder: the cost of an event, and what it adds to a message.
    Recorder(recorder::Args),
    /// Processes that are stopped and killed, and a bad link: what was acknowledged has arrived.
    Soak(soak::Args),
    /// Random executors, judged from outside against what budgets guarantee.
    Torture(torture::Args),
}

/// Runs it.
pub(crate) fn run(which: Bench) -> Outcome {
    match which {
        Bench::Enforcement(args) => enforcement::run(&args),
        Bench::Handoff(args) => handoff::run(&args),
        Bench::InProcess(args) => in_process::run(&args),
        Bench::Xrce(args) => xrce::run(&args),
        Bench::Ros2(args) => ros2::run(&args),
        Bench::RoundTrip(args) => round_trip::run(&args),
        Bench::Secure(args) => secure::run(&args),
        Bench::Load(args) => load::run(&args),
        Bench::Dispatch(args) => dispatch::run(&args),
        Bench::Foreign(which) => foreign::run(&which),
        Bench::Recorder(args) => recorder::run(&args),
        Bench::Soak(args) => soak::run(&args),
        Bench::Torture(args) => torture::run(&args),
    }
}
