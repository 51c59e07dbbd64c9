//! The options about logging. The loggers of nodes obey them.

/// A severity, as `rcutils` names them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// 10.
    Debug,
    /// 20.
    Info,
    /// 30.
    Warn,
    /// 40.
    Error,
    /// 50.
    Fatal,
}

impl LogLevel {
    pub(crate) const ALLOWED: &str = "debug, info, warn, error or fatal";

    /// By its name, in any case.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "debug" => Self::Debug,
            "info" => Self::Info,
            "warn" => Self::Warn,
            "error" => Self::Error,
            "fatal" => Self::Fatal,
            _ => return None,
        })
    }

    /// Its number in messages: 10 for debug to 50 for fatal.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Debug => 10,
            Self::Info => 20,
            Self::Warn => 30,
            Self::Error => 40,
            Self::Fatal => 50,
        }
    }

    /// By its number in messages.
    #[must_use]
    pub const fn numbered(number: u32) -> Option<Self> {
        Some(match number {
            10 => Self::Debug,
            20 => Self::Info,
            30 => Self::Warn,
            40 => Self::Error,
            50 => Self::Fatal,
            _ => return None,
        })
    }

    /// Its name on the console: `DEBUG` to `FATAL`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Debug => "DEBUG",
            Self::Info => "INFO",
            Self::Warn => "WARN",
            Self::Error => "ERROR",
            Self::Fatal => "FATAL",
        }
    }
}

/// The options about logging.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct LogArgs {
    /// `--log-level LEVEL`: for all loggers.
    pub level: Option<LogLevel>,
    /// `--log-level NAME:=LEVEL`, in their order.
    pub loggers: Vec<(String, LogLevel)>,
    /// `--log-config-file FILE`.
    pub config_file: Option<String>,
    /// `--log-file-name PREFIX`.
    pub file_name: Option<String>,
    /// False by `--disable-stdout-logs`.
    pub stdout: bool,
    /// False by `--disable-rosout-logs`.
    pub rosout: bool,
    /// False by `--disable-external-lib-logs`.
    pub external_lib: bool,
}

impl Default for LogArgs {
    fn default() -> Self {
        Self {
            level: None,
            loggers: Vec::new(),
            config_file: None,
            file_name: None,
            stdout: true,
            rosout: true,
            external_lib: true,
        }
    }
}

impl LogArgs {
    /// The level of the logger `name`, the last that was said; its parents' where it has none
    /// (`robot` for `robot.arm`).
    #[must_use]
    pub fn level_of(&self, name: &str) -> Option<LogLevel> {
        let mut name = name;
        loop {
            let said = self.loggers.iter().rev().find(|(n, _)| n == name);
            if let Some((_, level)) = said {
                return Some(*level);
            }
            match name.rsplit_once('.') {
                Some((parent, _)) => name = parent,
                None => return self.level,
            }
        }
    }
}
