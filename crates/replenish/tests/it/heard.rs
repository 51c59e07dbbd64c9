//! The events of quality of service that callbacks have heard.

use replenish::{CallbackContext, QosEvent};
use std::sync::{Arc, Mutex};

#[derive(Clone, Default)]
pub(crate) struct Heard(Arc<Mutex<Vec<QosEvent>>>);

impl Heard {
    pub(crate) fn sink(&self) -> impl FnMut(&QosEvent, &CallbackContext<'_>) + Send + 'static {
        let heard = self.clone();
        move |event, _| heard.0.lock().unwrap().push(*event)
    }

    pub(crate) fn all(&self) -> Vec<QosEvent> {
        self.0.lock().unwrap().clone()
    }
}
