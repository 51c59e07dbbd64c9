//! A context as a program's `main` sets it up.

use super::args::Args;
use super::signals;
use crate::context::Context;
use crate::error::Error;
use replenish_args::RosArgs;

impl Context {
    /// The same connection with a program's arguments: its nodes, topics, services and parameters
    /// get the names and values that they say. To be called before nodes are made: earlier nodes
    /// and clones belong to another context.
    ///
    /// ```
    /// use replenish::args::{Environment, RosArgs};
    /// use replenish::{Context, Descriptor, ParameterOptions};
    ///
    /// let line = "robot --ros-args -r __ns:=/left -p speed:=2.5";
    /// let args = RosArgs::parse(line.split(' ').map(String::from), &Environment::default())?;
    /// let ctx = Context::in_process().with_args(args); // Context::from_args() in a program
    /// let node = ctx.node("arm")?;
    /// assert_eq!(node.name(), "/left/arm");
    /// let parameters = node.parameters(ParameterOptions::new())?;
    /// parameters.declare("speed", 1.0, Descriptor::new())?;
    /// assert_eq!(parameters.get::<f64>("speed")?, 2.5);
    /// # Ok::<(), replenish::Error>(())
    /// ```
    #[must_use]
    pub fn with_args(self, args: RosArgs) -> Self {
        self.with_process_args(Args(args))
    }

    /// The arguments; empty unless the program passed them.
    #[must_use]
    pub fn args(&self) -> &RosArgs {
        &self.process_args().0
    }

    /// From now on SIGINT (Ctrl-C) and SIGTERM stop the executors of this context that start after
    /// this call, as [`StopHandle::stop`](crate::StopHandle::stop) does: `spin` returns its report,
    /// and `main` goes on. A second signal, 0.3 s later or more, ends the process at once. A
    /// library leaves this to its program; [`from_args`](Self::from_args) does it.
    ///
    /// # Errors
    /// [`Error::Thread`] if the system refuses handlers or a thread.
    pub fn stop_on_signals(&self) -> Result<(), Error> {
        self.ends().ask()
    }

    /// False as soon as a signal has asked the process to end: for loops of one's own.
    #[must_use]
    pub fn ok(&self) -> bool {
        !signals::ended()
    }
}
