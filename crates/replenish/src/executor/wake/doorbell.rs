//! The bells of this executor's workers, which may end a wait on the middleware.

use crate::handoff::{self, Wake};
use crate::middleware::Middleware;

pub(crate) type Doorbell = handoff::Doorbell<dyn Middleware>;
pub(crate) type WakeHandle = handoff::WakeHandle<dyn Middleware>;

impl Wake for dyn Middleware {
    fn wake(&self) {
        Middleware::wake(self);
    }
}
