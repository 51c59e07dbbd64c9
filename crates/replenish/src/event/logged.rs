//! Feature `log`: events as records of the `log` facade, target `replenish`. The program installs a
//! logger (`log::set_logger`), on a microcontroller as well; without one, or above its level, an
//! event costs one comparison.

use super::kinds::Event;
use log::Level;

/// Errors are what stops a handle, a worker or the executor; warnings are what costs samples or a
/// guarantee; a link that has come up is information.
const fn level(event: &Event<'_>) -> Level {
    match event {
        Event::CallbackPanicked { .. } | Event::ThreadPanicked { .. } | Event::Stuck { .. } => {
            Level::Error
        }
        Event::Fallback { .. }
        | Event::CallbackFailed { .. }
        | Event::Undecodable { .. }
        | Event::Oversize { .. }
        | Event::MiddlewareFailed { .. }
        | Event::Blocked { .. }
        | Event::HeldTooLong { .. }
        | Event::ChainExceeded { .. }
        | Event::Incompatible { .. }
        | Event::Link { up: false } => Level::Warn,
        Event::Link { up: true } => Level::Info,
    }
}

/// Hands the event to the program's logger.
pub(crate) fn tell(event: &Event<'_>) {
    log::log!(target: "replenish", level(event), "{event}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    static LINES: Mutex<Vec<String>> = Mutex::new(Vec::new());

    struct Keeper;

    impl log::Log for Keeper {
        fn enabled(&self, _: &log::Metadata<'_>) -> bool {
            true
        }

        fn log(&self, record: &log::Record<'_>) {
            let line = format!("{} {}: {}", record.level(), record.target(), record.args());
            LINES.lock().unwrap().push(line);
        }

        fn flush(&self) {}
    }

    #[test]
    fn events_reach_the_logger_with_their_level_and_not_below_it() {
        log::set_logger(&Keeper).unwrap();
        log::set_max_level(log::LevelFilter::Warn);
        tell(&Event::Link { up: true }); // information: below the level
        tell(&Event::Link { up: false });
        tell(&Event::Stuck { thread: "high" });
        assert_eq!(
            *LINES.lock().unwrap(),
            [
                "WARN replenish: link is down",
                "ERROR replenish: high has not ended in time; demoted and left behind"
            ]
        );
    }
}
