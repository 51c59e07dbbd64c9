//! A ROS 2 and micro-ROS executor that gives every callback a CPU budget.
//!
//! - [`Context`], [`Node`], [`Publisher`]: where messages come from and go to.
//! - [`Context::from_args`]: what ROS gives a program: arguments, files of parameters, Ctrl-C.
//! - [`Executor`] and its [workers](Executor::worker): threads with a policy and a [`Budget`] each,
//!   that run subscriptions, timers, services, clients, [actions](ActionOptions) and
//!   [guard conditions](GuardCondition). [`Group`]: callbacks that never run at the same time.
//! - [`Parameters`], [`Lifecycle`]: what ROS 2 asks of a node.
//! - [`Executor::recorder`], [`Mark`]: the last events of every thread, readable from outside.
//! - [`Executor::dump`], [`Dump`]: the same in a file when something goes wrong.
//! - [`Report`]: what every thread got from the kernel and what every handle has been through.
//! - [`prelude`]: the names that most programs use. [`interfaces`]: messages, services, actions.
//! - [`middleware`]: the seam between the executor and whatever carries the bytes.
//!
//! # Features
//! | feature | default | what it brings |
//! |---|---|---|
//! | `std` | yes | UDP, TCP and serial lines of Linux; [`Context::ros2`]: ROS 2 without an agent; panics caught callback by callback; brings `full` and `texts` |
//! | `plan` | yes | guarantees, admission, deployment files; brings `std` |
//! | `xrce` | yes | the micro-ROS middleware |
//! | `full` | with `std` | services, actions, handles that come and go, histograms, long samples, the server of POSIX |
//! | `texts` | with `std` | errors and reports in words, [`Event::Incompatible`] |
//! | `log` | no | events go to the program's logger |
//! | `freertos`, `nuttx` | no | the back end of that system, on its targets |
//!
//! Without feature `std` the crate needs `core`, `alloc` and `replenish-os` alone; memory is then
//! taken while the executor is described and started, and not after.
#![forbid(unsafe_code)]
#![cfg_attr(not(feature = "std"), no_std)]

extern crate alloc;

mod action;
mod chain;
mod compatibility;
mod context;
mod error;
mod event;
mod executor;
mod histogram;
mod lifecycle;
mod name;
mod parameter;
mod platform;
#[cfg_attr(not(feature = "std"), path = "process_disabled.rs")]
mod process;
mod publisher;
mod recorder_feed;
mod service;
mod stats;
mod window;

use replenish_handoff::{self as handoff, sync};

pub mod middleware;
pub mod prelude;
pub mod qos;

pub use action::{
    AcceptedGoal, ActionClient, ActionOptions, GoalCall, GoalError, GoalEvent, GoalHandle, GoalId,
    GoalState, GoalUpdate, Lost, NewGoal, ResultCall, RunningGoal,
};
pub use chain::{ChainInstance, ChainReport};
pub use compatibility::QosClash;
pub use context::{Context, Node};
pub use error::Error;
pub use event::Event;
pub use executor::{
    AddHandles, AdmissionReport, AdoptedReport, CallbackContext, CallbackResult, DeadlineMiss,
    DispatcherReport, Every, Executor, Group, GuardCondition, HandleOptions, HandleReport,
    HandleStates, LocalExecutor, OnMiss, Overrun, RawType, Report, RoundReport, RoundStats,
    RunningExecutor, Semantics, SpinEnd, SpinResult, StopHandle, ThreadReport, TimerHandle, Topic,
    Trigger, WorkerBuilder,
};
#[cfg(feature = "full")]
pub use executor::{ExecutorHandle, HandleId, Removal, WorkerHandle};
pub use histogram::Histogram;
pub use lifecycle::{Lifecycle, LifecycleError, ManagedPublisher, Outcome, State, Transition};
pub use middleware::PublishError;
pub use name::NameError;
pub use parameter::{
    Descriptor, FromParameter, ParameterChange, ParameterError, ParameterErrorKind,
    ParameterOptions, ParameterValue, Parameters,
};
pub use platform::{Dump, Mark, StaticText, Text};
#[allow(
    unused_imports,
    unreachable_pub,
    reason = "there is nothing in it without feature `std`"
)]
pub use process::public::*;
pub use publisher::Publisher;
pub use qos::{Criticality, IngressLimit, Liveliness, Qos};
pub use recorder_feed::RecorderFeed;
/// The packages of interfaces that programs of robots use, generated: with feature `std` those
/// of `replenish-interfaces/common`. A program that needs others depends on
/// `replenish-interfaces` with their features.
pub use replenish_interfaces as interfaces;
pub use replenish_msg as msg;
pub use replenish_os::{
    Enforcement, EnforcerStats, Low, OverrunSummary, ParamError, Params, Policy, PolicyError,
    Stall, Usage,
};
/// Planning, deployment files, the ledger.
#[cfg(feature = "plan")]
pub use replenish_plan::{self as planning, Guarantee};
pub use service::call::Call;
pub use service::client::Client;
pub use service::error::{CallError, NoReply};
pub use service::responder::Responder;
pub use sporadic::{Amount, Budget, Kind as ServerKind};
pub use stats::HandleStats;

/// Nanoseconds; of `CLOCK_MONOTONIC` where it is an instant.
pub type Nanos = u64;

/// The examples of the READMEs and guides compile, or are refused where they say so.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
#[doc = include_str!("../../../README.md")]
#[doc = include_str!("../../../docs/executor.md")]
#[doc = include_str!("../../../docs/compile-time.md")]
#[doc = include_str!("../../../docs/see-it.md")]
#[doc = include_str!("../../../docs/ros-program.md")]
#[doc = include_str!("../../../docs/json.md")]
#[doc = include_str!("../../../docs/qos.md")]
#[doc = include_str!("../../../docs/guarantees.md")]
#[doc = include_str!("../../../docs/messages.md")]
#[doc = include_str!("../../../docs/rtps.md")]
#[doc = include_str!("../../../docs/foreign-programs.md")]
#[doc = include_str!("../../../docs/actions.md")]
#[doc = include_str!("../../../docs/tutorial.md")]
#[doc = include_str!("../../../docs/from-rclcpp.md")]
#[doc = include_str!("../../../docs/from-rclrs.md")]
#[doc = include_str!("../../../docs/from-rclc.md")]
#[doc = include_str!("../../../docs/from-micro-ros.md")]
struct DocumentedExamples;
