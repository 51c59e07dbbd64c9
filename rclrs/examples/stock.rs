//! The paper's Figure 3 over rclrs as it is.
//!
//! Two topics have 10 ms of work for each message and a message every 10 ms. `budgets.rs` is the
//! same program with a budget.
//!
//!     taskset -c 1 stock SECONDS        # beside it, on another CPU: ping

mod load;

use load::{answer, latest, ms, until};
use rclrs::*;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let context = Context::default();
    let mut executor = context.create_basic_executor();
    let node = executor.create_node("pong")?;
    let high = node.create_worker(());
    let low = node.create_worker(());
    let _high = high.create_subscription(latest("high"), answer(&node, "high_pong", ms(10))?)?;
    let _low = low.create_subscription(latest("low"), answer(&node, "low_pong", ms(10))?)?;
    executor.spin(until()).timeout_ok().first_error()?;
    Ok(())
}
