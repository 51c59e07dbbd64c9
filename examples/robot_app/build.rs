//! Generates `rover_msgs` from its `.msg`, `.srv` and `.action` files.

fn main() -> Result<(), replenish_msg_gen::Error> {
    replenish_msg_gen::Generator::new()
        .package_dir("msgs/rover_msgs")
        .generate_for_cargo()
}
