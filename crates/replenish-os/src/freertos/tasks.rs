//! The kernel's figures on every task and on itself: for reports and tests.

use super::ffi;
use super::start;
use super::task_slot::{self, TaskSlot};
use crate::Nanos;
use crate::Tid;
use crate::rtos::thread::Thread;
use crate::rtos::tid;

/// One task at this moment.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub struct TaskUse {
    /// Its number.
    pub tid: Tid,
    /// The first 15 bytes of its name.
    pub name: &'static str,
    /// The priority it has now, an inherited one included; 0 while it is suspended.
    pub priority: u8,
    /// Its stack in bytes.
    pub stack_bytes: usize,
    /// Bytes of its stack that were never used so far.
    pub stack_unused: usize,
    /// CPU time so far, interrupts that came meanwhile included.
    pub cpu: Nanos,
    /// Number of times that it has lost the CPU because it waited. Wraps around.
    pub blocks: u32,
    /// Number of times that the kernel chose again while it could have gone on. Wraps around.
    pub preemptions: u32,
}

/// All tasks, the newest first; the idle task is not among them. Any task may ask; looking at a
/// stack takes time in proportion to what was never used of it.
pub fn tasks() -> impl Iterator<Item = TaskUse> {
    task_slot::all().filter_map(of)
}

fn of(slot: &'static TaskSlot) -> Option<TaskUse> {
    let now = ffi::board_now();
    let (task, cpu, blocks, preemptions) = slot
        .state
        .with(|s| (s.task, s.cpu(now), s.blocks, s.preemptions));
    let task = task?;
    Some(TaskUse {
        tid: tid::of(slot),
        name: ffi::name(task),
        priority: ffi::priority(task),
        stack_bytes: slot.stack_bytes,
        stack_unused: ffi::stack_unused(task),
        cpu,
        blocks,
        preemptions,
    })
}

/// Counters of the kernel and of this back end since the start; they wrap around.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[non_exhaustive]
pub struct KernelUse {
    /// Number of times that the idle task has waited for an interrupt (`WFI`).
    pub idle_waits: u32,
    /// Number of times that the board's timer has rung.
    pub alarms: u32,
}

/// The board's sleeps so far.
#[must_use]
pub fn kernel() -> KernelUse {
    KernelUse {
        idle_waits: ffi::idle_waits(),
        alarms: start::alarms(),
    }
}

impl<T> Thread<T> {
    /// Bytes of its stack that were never used so far.
    #[must_use]
    pub fn stack_unused(&self) -> usize {
        self.slot
            .state
            .with(|s| s.task)
            .map_or(0, ffi::stack_unused)
    }
}
