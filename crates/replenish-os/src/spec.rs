//! The request for a new thread: name, policy, CPU, stack.

use crate::Policy;
use alloc::string::String;

/// The properties of a new thread. Built in steps:
/// `ThreadSpec::new("high").policy(Policy::fifo(60)?).cpu(1)`.
#[derive(Clone, PartialEq, Eq, Debug)]
#[must_use]
pub struct ThreadSpec {
    /// Shown by `ps -L`, `top -H` and debuggers; systems keep the first 15 bytes.
    pub name: String,
    /// The policy; [`Policy::Other`] if not said, which on a microcontroller is the lowest
    /// priority.
    pub policy: Policy,
    /// The CPU the thread is pinned to; `None`: those its creator may use. Microcontrollers have
    /// number 0.
    pub cpu: Option<usize>,
    /// The stack in bytes; `None`: the 2 MiB of the standard library, under FreeRTOS 2048, under
    /// `NuttX` 4096. With [`memory::lock_all`](crate::memory::lock_all) all of it occupies memory.
    pub stack_size: Option<usize>,
    /// Whether threads and processes the thread creates start in `SCHED_OTHER`; true if not said.
    /// Without it user code can leave its budget by spawning a thread. Linux only.
    pub reset_on_fork: bool,
}

impl ThreadSpec {
    /// A thread called `name` under [`Policy::Other`], on any CPU.
    pub fn new(name: impl Into<String>) -> Self {
        let name = name.into();
        Self {
            name,
            policy: Policy::Other,
            cpu: None,
            stack_size: None,
            reset_on_fork: true,
        }
    }

    /// Sets the policy.
    pub fn policy(mut self, policy: Policy) -> Self {
        self.policy = policy;
        self
    }

    /// Pins the thread to one CPU.
    pub fn cpu(mut self, cpu: impl Into<Option<usize>>) -> Self {
        self.cpu = cpu.into();
        self
    }

    /// Sets the stack size in bytes.
    pub fn stack_size(mut self, bytes: usize) -> Self {
        self.stack_size = Some(bytes);
        self
    }

    /// Says whether children start in `SCHED_OTHER`.
    pub fn reset_on_fork(mut self, reset: bool) -> Self {
        self.reset_on_fork = reset;
        self
    }
}
