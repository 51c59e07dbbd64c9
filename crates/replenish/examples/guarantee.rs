//! A control loop with a guarantee: so many percent of a CPU.
//!
//! Run: `cargo run --release -p replenish --example guarantee -- 50`; stop it with Ctrl-C. Another
//! one with 60 is refused while the first one lives.
//!
//! On a machine with several CPUs the second one goes to another; a second argument pins both to
//! one.

use replenish::{Context, Error, Executor, Guarantee};
use std::time::Duration;

fn main() -> Result<(), Error> {
    let mut args = std::env::args().skip(1).map(|arg| arg.parse::<u32>().ok());
    let percent = args.next().flatten().unwrap_or(50);
    let cpu = args
        .next()
        .flatten()
        .and_then(|cpu| usize::try_from(cpu).ok());
    let ms = Duration::from_millis(1);

    let mut exec = Executor::new(&Context::in_process());
    let mut worker = exec
        .worker("control")
        .guarantee(Guarantee::of(percent * ms).every(100 * ms).importance(200));
    if let Some(cpu) = cpu {
        worker = worker.cpu(cpu);
    }
    worker.timer(10 * ms, |_| ())?;

    let running = exec.start()?;
    let report = running.report();
    for worker in report.admission.plan.iter().flat_map(|plan| &plan.workers) {
        let cpu = worker.cpu.map_or("any".into(), |cpu| cpu.to_string());
        println!("{}: priority {}, CPU {cpu}", worker.name, worker.priority());
        for reason in &worker.reasons {
            println!("  {reason}");
        }
    }
    match &report.admission.ledger {
        Some(directory) => println!("reserved in {}", directory.display()),
        None => println!("not reserved: {}", report.fallbacks.join("; ")),
    }
    println!("{}", running.wait());
    Ok(())
}
