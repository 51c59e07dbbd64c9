//! Whether an executor publishes its diagnostics.

/// `None`: where the middleware is ROS 2 itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct DiagnosticsChoice(pub(super) Option<bool>);
