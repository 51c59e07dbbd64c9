//! The rover. Ctrl-C ends it with a report.
//!
//! Run: `REPLENISH_AGENT=in-process cargo run --release -p robot-app -- --ros-args -p gain:=0.8`.

use replenish::{Context, Error, Executor};

fn main() -> Result<(), Error> {
    let ctx = Context::from_args()?;
    let mut exec = Executor::new(&ctx);
    robot_app::rover(&ctx, &mut exec)?;
    println!("{}", exec.spin()?);
    Ok(())
}
