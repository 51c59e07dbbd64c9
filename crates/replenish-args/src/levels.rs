//! The levels of names. Room for those that are set later is there from the start: nothing
//! allocates when a service sets one.

use crate::log::{LogArgs, LogLevel};

/// Names that may get a level besides those of the arguments.
const ROOM: usize = 64;
/// The longest such name, in bytes.
const LONGEST: usize = 256;

/// A level for each of some loggers, and one for all others. 64 names, each of up to 256 bytes, can
/// be set besides those of the arguments.
#[derive(Debug)]
pub struct LogLevels {
    all: Option<LogLevel>,
    names: Vec<(String, Option<LogLevel>)>,
}

impl LogLevels {
    /// The levels that the arguments say. Allocates here only.
    #[must_use]
    pub fn new(args: &LogArgs) -> Self {
        let mut names: Vec<(String, Option<LogLevel>)> = Vec::new();
        for (name, level) in &args.loggers {
            names.retain(|(n, _)| n != name); // the last that was said counts
            names.push((name.clone(), Some(*level)));
        }
        let room = || (String::with_capacity(LONGEST), None);
        names.extend(core::iter::repeat_with(room).take(ROOM));
        Self {
            all: args.level,
            names,
        }
    }

    /// The level that was said for this very name; the empty one stands for all.
    #[must_use]
    pub fn own(&self, name: &str) -> Option<LogLevel> {
        if name.is_empty() {
            return self.all;
        }
        let found = self.names.iter().find(|(n, _)| n == name);
        found.and_then(|(_, level)| *level)
    }

    /// The level of the name, or of the nearest parent that has one (`robot` for `robot.arm`);
    /// `Info` without any.
    #[must_use]
    pub fn of(&self, name: &str) -> LogLevel {
        let mut name = name;
        loop {
            if let Some(level) = self.own(name) {
                return level;
            }
            name = match name.rsplit_once('.') {
                Some((parent, _)) => parent,
                None if name.is_empty() => return LogLevel::Info,
                None => "",
            };
        }
    }

    /// The lowest level that the name, or a child of it, has.
    #[must_use]
    pub fn lowest(&self, name: &str) -> LogLevel {
        let is_child = |n: &str| {
            n.strip_prefix(name)
                .is_some_and(|rest| rest.starts_with('.'))
        };
        let children = self.names.iter().filter(|(n, _)| is_child(n));
        let levels = children.filter_map(|(_, level)| *level);
        levels
            .chain([self.of(name)])
            .min_by_key(|level| level.number())
            .unwrap_or(LogLevel::Info)
    }

    /// Sets the level of a name, or takes it away.
    ///
    /// # Errors
    /// The reason, for a name that is too long or one too many.
    pub fn set(&mut self, name: &str, level: Option<LogLevel>) -> Result<(), &'static str> {
        if name.is_empty() {
            self.all = level;
            return Ok(());
        }
        if let Some((_, known)) = self.names.iter_mut().find(|(n, _)| n == name) {
            *known = level;
            return Ok(());
        }
        if level.is_none() {
            return Ok(());
        }
        let mut free = self.names.iter_mut().filter(|(_, level)| level.is_none());
        let Some((slot, free)) = free.find(|(slot, _)| slot.capacity() >= name.len()) else {
            return Err("name: of up to 256 bytes; 64 names may have a level of their own");
        };
        slot.clear();
        slot.push_str(name);
        *free = level;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_holds_for_a_name_and_its_children_until_it_is_taken_away() {
        let args = LogArgs {
            level: Some(LogLevel::Warn),
            loggers: vec![
                ("a.b".into(), LogLevel::Fatal),
                ("a.b".into(), LogLevel::Debug),
            ],
            ..LogArgs::default()
        };
        let mut levels = LogLevels::new(&args);
        assert_eq!(levels.of("a"), LogLevel::Warn);
        assert_eq!(levels.of("a.b.c"), LogLevel::Debug);
        assert_eq!(levels.of("a.bc"), LogLevel::Warn);
        levels.set("a", Some(LogLevel::Error)).unwrap();
        assert_eq!(levels.own("a.x"), None);
        assert_eq!(levels.of("a.x"), LogLevel::Error);
        levels.set("a.b", None).unwrap();
        assert_eq!(levels.of("a.b.c"), LogLevel::Error);
        levels.set("", None).unwrap();
        assert_eq!(levels.of("other"), LogLevel::Info);
    }

    #[test]
    fn names_that_lose_their_level_make_room() {
        let mut levels = LogLevels::new(&LogArgs::default());
        for round in 0..3 {
            for n in 0..ROOM {
                levels
                    .set(&format!("{round}.{n}"), Some(LogLevel::Debug))
                    .unwrap();
            }
            assert!(levels.set("more", Some(LogLevel::Debug)).is_err());
            levels.set("more", None).unwrap();
            for n in 0..ROOM {
                levels.set(&format!("{round}.{n}"), None).unwrap();
            }
        }
        let long = "x".repeat(LONGEST + 1);
        assert!(levels.set(&long, Some(LogLevel::Debug)).is_err());
    }
}
