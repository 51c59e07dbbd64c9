//! The arguments of a ROS 2 program: `--ros-args`, remapping, files of parameters.
//!
//! ```text
//!   arguments ─► flags ─┬─► rule ─► pattern · name      (-r)
//!                       ├─► parameters ─► yaml ─► value (-p, --params-file)
//!                       └─► log ─► levels               (--log-level, --disable-…-logs)
//!   console: how lines of a log look
//!   environment: ROS_NAMESPACE, ROS_DOMAIN_ID, …
//! ```
//!
//! Everything is read once, at the start: [`RosArgs::from_env`]. Nothing here knows a middleware.
//! The rules are those of the ROS 2 design pages *static remapping* and *command line arguments*,
//! and of `rcl`'s parser where the pages are silent; `*`, `**` and `\1`, which `rcl` refuses as
//! "not implemented", are as the page on remapping has them.
//!
//! ```
//! use replenish_args::{Environment, Kind, RosArgs};
//! let line = "talker --ros-args -r __ns:=/robot -r chatter:=/news -p rate:=10.0";
//! let args = line.split(' ').map(String::from);
//! let args = RosArgs::parse(args, &Environment::default())?;
//! let node = args.node("/talker", false)?;
//! assert_eq!(node, "/robot/talker");
//! assert_eq!(args.name(Kind::Topic, "/robot/chatter", &node)?, "/news");
//! assert_eq!(args.parameter(&node, "rate").unwrap().value.to_string(), "10.0");
//! # Ok::<(), replenish_args::ArgsError>(())
//! ```
#![forbid(unsafe_code)]

mod arguments;
mod console;
mod environment;
mod error;
mod flags;
mod levels;
mod log;
mod name;
mod parameters;
mod pattern;
mod rule;
mod value;
mod yaml;

pub use arguments::RosArgs;
pub use console::{ConsoleFormat, LogLine};
pub use environment::Environment;
pub use error::ArgsError;
pub use levels::LogLevels;
pub use log::{LogArgs, LogLevel};
pub use parameters::Override;
pub use rule::Kind;
pub use value::Value;
