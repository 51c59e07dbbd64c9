//! [`Presence`]: a node is in the graph for as long as the program has a handle to it.

use crate::error::Error;
use crate::middleware::Middleware;
use core::fmt;
use std::sync::Arc;

/// Keeps a node in the graph. The last clone takes it out.
#[derive(Clone)]
pub(crate) struct Presence {
    _entered: Arc<Entered>,
}

struct Entered {
    middleware: Arc<dyn Middleware>,
    node: Arc<str>,
}

impl Presence {
    /// The node of this full name is there from now on.
    pub(crate) fn of(middleware: &Arc<dyn Middleware>, node: &Arc<str>) -> Result<Self, Error> {
        let entered = middleware.enter_node(node);
        entered.map_err(|e| Error::endpoint("node", node, e))?;
        Ok(Self {
            _entered: Arc::new(Entered {
                middleware: Arc::clone(middleware),
                node: Arc::clone(node),
            }),
        })
    }
}

impl fmt::Debug for Presence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Presence")
    }
}

impl Drop for Entered {
    fn drop(&mut self) {
        self.middleware.leave_node(&self.node);
    }
}
