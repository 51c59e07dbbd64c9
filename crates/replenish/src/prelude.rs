//! The names that most programs use: `use replenish::prelude::*`.
//!
//! ```no_run
//! use replenish::interfaces::std_msgs::msg::Header;
//! use replenish::prelude::*;
//! use std::time::Duration;
//!
//! fn main() -> Result<(), replenish::Error> {
//!     let ctx = Context::in_process();
//!     let node = ctx.node("talker")?;
//!     let logger = node.logger();
//!     let out = node.publisher::<Header>("stamps", Qos::reliable())?;
//!     let mut exec = Executor::new(&ctx);
//!     exec.worker("talk")
//!         .budget(Budget::of(Duration::from_millis(1)).every(Duration::from_millis(10)))
//!         .timer(Duration::from_millis(10), move |_| {
//!             log_info!(logger.once(), "talks");
//!             out.publish(&Header { stamp: node.now(), ..Header::default() })
//!         })?;
//!     println!("{}", exec.spin()?);
//!     Ok(())
//! }
//! ```
//!
//! `Error` is not among them, since most programs have one of their own.

pub use crate::action::{
    ActionClient, ActionOptions, GoalHandle, GoalState, GoalUpdate, NewGoal, RunningGoal,
};
pub use crate::context::{Context, Node};
pub use crate::event::Event;
pub use crate::executor::{
    CallbackContext, Every, Executor, Group, GuardCondition, HandleOptions, LocalExecutor, Topic,
    Trigger, WorkerBuilder,
};
pub use crate::lifecycle::{Lifecycle, Outcome, Transition};
pub use crate::parameter::{Descriptor, ParameterOptions, ParameterValue, Parameters};
#[allow(
    unused_imports,
    unreachable_pub,
    reason = "there is nothing in it without feature `std`"
)]
pub use crate::process::prelude::*;
pub use crate::publisher::Publisher;
pub use crate::qos::{Liveliness, Qos};
pub use crate::service::client::Client;
pub use crate::service::responder::Responder;
pub use replenish_msg::{Action, Message, Service};
pub use replenish_os::Policy;
pub use sporadic::Budget;
