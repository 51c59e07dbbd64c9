//! Heap that pong takes at set-up: the image `memory` prints it step by step, with two and three
//! workers, with budgets and without; the differences are what one of each takes.

use super::qemu;
use crate::output::Outcome;
use serde_json::Value;
use std::path::Path;

/// Stacks of dispatcher and enforcer in bytes.
const DISPATCHER: u64 = 4096;
const ENFORCER: u64 = 3072;

/// Bytes of the heap, without stacks.
pub(crate) struct Memory {
    /// Pong with two budgeted workers: client, and executor with all that belongs to it.
    pub(crate) client: u64,
    pub(crate) executor: u64,
    /// One of each.
    pub(crate) publisher: u64,
    pub(crate) subscription: u64,
    pub(crate) worker: u64,
    pub(crate) budget: u64,
    /// All stacks, with the given size for each worker.
    pub(crate) stacks: u64,
}

/// Boots the image four times.
pub(crate) fn measure() -> Outcome<Memory> {
    let image = qemu::build_without_texts("memory")?;
    let two = Run::of(&image, &["2"])?;
    let three = Run::of(&image, &["3"])?;
    let plain_two = Run::of(&image, &["2", "plain"])?;
    let plain_three = Run::of(&image, &["3", "plain"])?;
    let stack = two.number("stack")?;
    let plain = plain_three.number("start")? - plain_two.number("start")? - stack;
    let budgeted = three.number("start")? - two.number("start")? - stack;
    let client = two.number("client")?;
    let stacks = 2 * stack + DISPATCHER + ENFORCER;
    Ok(Memory {
        client,
        executor: two.sum()? - client - stacks,
        // The second worker's figures: by then the lists have room.
        publisher: two.number("publisher second")?,
        subscription: two.number("subscription second")?,
        worker: two.number("worker second")? + plain,
        budget: budgeted - plain,
        stacks,
    })
}

/// The image's figures.
struct Run(Value);

impl Run {
    fn of(image: &Path, words: &[&str]) -> Outcome<Self> {
        let words: Vec<String> = words.iter().map(|w| (*w).to_string()).collect();
        qemu::measure(image, &words).map(Self)
    }

    fn number(&self, step: &str) -> Outcome<u64> {
        let number = self.0.get(step).and_then(Value::as_u64);
        number.ok_or_else(|| format!("the image `memory` did not say what `{step}` takes"))
    }

    /// Everything, stacks included.
    fn sum(&self) -> Outcome<u64> {
        let steps = self
            .0
            .as_object()
            .ok_or("the image `memory` said no steps")?;
        let steps = steps
            .iter()
            .filter(|(name, _)| *name != "stack" && *name != "workers");
        Ok(steps.filter_map(|(_, bytes)| bytes.as_u64()).sum())
    }
}
