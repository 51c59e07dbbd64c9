//! Makes a plan or a refusal of a request, step by step.

use super::assign;
use super::describe::describe;
use super::elastic;
use super::plan::Plan;
use super::problem::Problem;
use super::refusal::{self, Refusal};
use crate::Request;

/// Makes a plan: chooses CPUs, priorities, background levels, budgets and replenishments, and
/// tests every deadline with the bounds of [`replenish_sim::analysis`].
///
/// Pure and deterministic. 1000 workers take a fraction of a second.
///
/// # Errors
/// If a parameter is out of range, or a deadline or a promise to another program would not hold.
pub fn plan(request: &Request) -> Result<Plan, Refusal> {
    let problem = Problem::new(request).map_err(Refusal::invalid)?;
    let (minimum, desired) = problem.amounts();
    let all: Vec<usize> = (0..problem.threads.len()).collect();
    if desired != minimum && assign::fits(&problem, &all, &desired) {
        let placed = assign::place(&problem, &all, &desired);
        return Ok(describe(&problem, &placed, &desired));
    }
    let mut placed = assign::place(&problem, &all, &minimum);
    if placed.failure().is_some() {
        return Err(refusal::refuse(&problem, &minimum, &placed));
    }
    let mut amounts = minimum;
    if desired != amounts {
        elastic::grow(&problem, &mut placed, &mut amounts, &desired);
    }
    Ok(describe(&problem, &placed, &amounts))
}
