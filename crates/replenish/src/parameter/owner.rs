//! The node's own rights over its parameters: it sets read-only ones, and describes them anew.

use super::descriptor::Descriptor;
use super::error::ParameterError;
use super::server::Parameters;
use super::store::Setter;
use super::value::ParameterValue;

impl Parameters {
    /// Sets one parameter, a read-only one too, which only the node's own program may. Its type and
    /// range hold, and callbacks are asked. Does not allocate.
    ///
    /// ```
    /// use replenish::{Context, Descriptor, ParameterOptions};
    /// let node = Context::in_process().node("battery")?;
    /// let parameters = node.parameters(ParameterOptions::new())?;
    /// parameters.declare("cycles", 0, Descriptor::new().read_only())?;
    /// assert!(parameters.set("cycles", 1).is_err());
    /// parameters.set_own("cycles", 1)?;
    /// assert_eq!(parameters.get::<i64>("cycles")?, 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`set`](Self::set), but for [`ReadOnly`](crate::ParameterErrorKind::ReadOnly).
    pub fn set_own<'v>(
        &self,
        name: &str,
        value: impl Into<ParameterValue<'v>>,
    ) -> Result<(), ParameterError> {
        self.set_all(Setter::Owner, core::iter::once((name, value.into())))
    }

    /// The descriptor of a parameter. Allocates for its texts.
    ///
    /// # Errors
    /// If there is no parameter of this name.
    pub fn descriptor(&self, name: &str) -> Result<Descriptor, ParameterError> {
        let table = self.inner.table.lock();
        table.find(name).map(|slot| slot.descriptor.clone())
    }

    /// Gives a parameter another descriptor: read-only or not any more, with another range or
    /// description. Its value stays, and must be allowed by the new one. ROS 2 has no event for
    /// that; others see it when they ask for the descriptor. Allocates.
    ///
    /// # Errors
    /// If there is no parameter of this name, if the range is not for its type or does not hold its
    /// value, and from a callback of setting.
    pub fn set_descriptor(&self, name: &str, descriptor: Descriptor) -> Result<(), ParameterError> {
        let inner = &*self.inner;
        inner.not_nested()?;
        let _turn = inner.setters.lock(); // nothing is staged meanwhile
        let old = inner.table.lock().describe(name, descriptor)?;
        drop(old); // its texts are freed when readers do not wait any more
        Ok(())
    }
}
