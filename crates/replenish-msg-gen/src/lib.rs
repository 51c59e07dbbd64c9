//! ROS 2 interface files to Rust, at build time.
//!
//! In `build.rs`, for a package in `msgs/my_msgs/{msg,srv,action}`:
//!
//! ```no_run
//! fn main() -> Result<(), replenish_msg_gen::Error> {
//!     replenish_msg_gen::Generator::new()
//!         .package_dir("msgs/my_msgs")
//!         .generate_for_cargo() // into OUT_DIR; or `.generate(dir)`
//! }
//! ```
//!
//! and in `lib.rs`:
//!
//! ```ignore
//! include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));
//! use my_msgs::msg::Status;
//! ```
//!
//! With `replenish` among the dependencies, its packages are known without further ado, and the
//! code names `replenish::msg`. With `replenish-interfaces` among them instead, the code names the
//! crate `replenish_msg` (see [`Generator::runtime`]).
//!
//! Everything that a `.msg` file can say is supported, and no other file format (`.idl`).
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod emit;
mod error;
mod generator;
mod hash;
mod model;
mod names;
mod package;
mod parse;
mod registry;

pub use error::{Error, Place};
pub use generator::Generator;
pub use package::check_text;
