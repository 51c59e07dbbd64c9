//! `replenish bench ros2`: round trips of ROS 2 without an agent, beside raw UDP, Cyclone DDS, and
//! rcl with Fast DDS.
//!
//! ```text
//!   command ─► windows      the paths take turns, size by size
//!      │          └► pair   two processes of one path: ping and echo
//!      │               └─► foreign: Cyclone DDS, rcl      where they are, what is missing
//!      │               └─► part: this program again ─► raw · wire · ours ─► ping
//!      ├─► flood        a control loop beside a flood on another topic
//!      ├─► encoding     a publication: encoded where it is kept, or copied there
//!      ├─► fragments    of a long sample: to the kernel together, or one by one
//!      └─► report           points, table, JSON
//! ```
//!
//! Every process has the same CPU and the same policy. A ping process gets a line for each window,
//! `window BYTES COUNT PERIOD_NS`, and answers `times LOST NS …`. The kernel's accounts of both
//! processes' threads say what the window cost.

mod command;
mod encoding;
mod flood;
mod foreign;
mod fragments;
mod ours;
mod pair;
mod part;
mod path;
mod ping;
mod raw;
mod report;
mod windows;
mod wire;

pub(crate) use command::{Args, run};
