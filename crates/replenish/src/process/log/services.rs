//! Levels from outside: `~/get_logger_levels` and `~/set_logger_levels`, on one worker.

use super::core::Core;
use crate::context::Node;
use crate::error::Error;
use crate::executor::{AddHandles, Target, Topic};
use crate::service::bytes::Unanswered;
use replenish_args::LogLevel;
use replenish_interfaces::rcl_interfaces::msg::{LoggerLevelView, SetLoggerLevelsResultView};
use replenish_interfaces::rcl_interfaces::srv;
use replenish_msg::wire::Encode;
use replenish_msg::{CdrWriter, View};

/// Bytes of a request or a response.
const MESSAGE: usize = 4096;

impl<T: Target> AddHandles<T> {
    /// Serves the levels of this context's loggers to others: two handles with the services
    /// `~/get_logger_levels` and `~/set_logger_levels` of ROS 2. A logger without a level of its
    /// own shows as 0; setting 0 takes the level away. Requests and responses take up to 4096 bytes
    /// each.
    ///
    /// # Errors
    /// As [`serve`](Self::serve).
    pub fn logger_levels(self, node: &Node) -> Result<T::AllAdded, Error> {
        let (get, set) = (node.log(), node.log());
        let of_size = |name| Topic::named(name).max_size(MESSAGE);
        let both = self
            .together()
            .serve_bytes::<srv::GetLoggerLevels>(
                node,
                of_size("~/get_logger_levels"),
                move |request, w| levels(get.core(), request, w),
            )?
            .serve_bytes::<srv::SetLoggerLevels>(
                node,
                of_size("~/set_logger_levels"),
                move |request, w| set_levels(set.core(), request, w),
            )?;
        Ok(both.all_added(1))
    }
}

fn levels(of: &Core, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::GetLoggerLevelsRequestView::from_payload(request)?;
    w.sequence(request.names.len())?;
    for name in request.names.iter() {
        let level = of.own_level(name).map_or(0, LogLevel::number).into();
        LoggerLevelView { name, level }.put(w)?;
    }
    Ok(())
}

fn set_levels(of: &Core, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::SetLoggerLevelsRequestView::from_payload(request)?;
    w.sequence(request.levels.len())?;
    for wish in request.levels.iter() {
        let level = LogLevel::numbered(wish.level);
        let reason = match level {
            None if wish.level != 0 => "level: allowed are 0, 10, 20, 30, 40, 50",
            _ => of.set_level(wish.name, level).err().unwrap_or_default(),
        };
        let successful = reason.is_empty();
        SetLoggerLevelsResultView { successful, reason }.put(w)?;
    }
    Ok(())
}
