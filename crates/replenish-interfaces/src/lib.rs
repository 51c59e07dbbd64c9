//! The common ROS 2 interface packages: `std_msgs::msg::Header`, `std_srvs::srv::SetBool`,
//! `example_interfaces::action::Fibonacci`.
//!
//! One feature per package. A type without unbounded fields is one struct, needs no allocator and
//! is its own view. Another type `Name` is a struct `NameView<'a>`, which borrows strings and
//! sequences from the bytes it is decoded from or from what is to be encoded, and, with feature
//! `alloc`, a struct `Name` that owns them and is what publishers and subscriptions take.
#![no_std]
#![forbid(unsafe_code)]

pub use replenish_msg;

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));
