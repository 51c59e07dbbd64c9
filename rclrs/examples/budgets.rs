//! The paper's Figure 3 over rclrs with a budget.
//!
//! `high` gets 30 ms in every 100 ms and `low` the rest. The same program as `stock.rs`, but for
//! three lines.
//!
//!     chrt -f 20 taskset -c 1 budgets SECONDS      # beside it, on another CPU: ping

mod load;

use load::{answer, latest, ms, until};
use rclrs::*;
use replenish_rclrs::{runtime, worker};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let context = Context::default();
    let mut executor = context.create_executor(runtime()?);
    let node = executor.create_node("pong")?;
    let high = node.create_worker(worker("high", ()).budget((ms(30), ms(100))).admit()?);
    let low = node.create_worker(());
    let _high = high.create_subscription(latest("high"), answer(&node, "high_pong", ms(10))?)?;
    let _low = low.create_subscription(latest("low"), answer(&node, "low_pong", ms(10))?)?;
    executor.spin(until()).timeout_ok().first_error()?;
    Ok(())
}
