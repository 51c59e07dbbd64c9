//! Generates `robot_msgs` twice: with a heap, and for a program without one.

use replenish_msg_gen::{Error, Generator};
use std::env;
use std::path::PathBuf;

fn main() -> Result<(), Error> {
    Generator::new()
        .package_dir("msgs/robot_msgs")
        .generate_for_cargo()?;
    // Everything inline: strings of at most 32 bytes, sequences of at most 8 elements. Types of
    // other packages in it have to be generated alike.
    let share = PathBuf::from(env::var_os("DEP_REPLENISH_INTERFACES_SHARE").unwrap_or_default());
    Generator::new()
        .package_dir("msgs/robot_msgs")
        .package_dir(share.join("std_msgs"))
        .package_dir(share.join("geometry_msgs"))
        .bound_strings(32)
        .bound_sequences(8)
        .without_heap()
        .generate(PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("inline"))
}
