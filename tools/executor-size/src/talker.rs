//! A talker of ROS 2 without an agent as an image for a microcontroller would have it, without
//! kernel and link. It is linked and measured, never run: its link is two registers in memory. On a
//! computer the program does nothing.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "../../../firmware/src/talker.rs"]
mod chatter;
#[cfg(target_os = "none")]
mod talker_image;

#[cfg(not(target_os = "none"))]
fn main() {}
