//! The macros that log. Arguments are evaluated only if the line is written.

/// Logs a line for developers: `log_debug!(logger, "x = {x}")`. See [`Logger`](crate::Logger).
#[macro_export]
macro_rules! log_debug {
    ($($line:tt)+) => { $crate::__log_line!(Debug, $($line)+) };
}

/// Logs information: `log_info!(logger, "x = {x}")`. See [`Logger`](crate::Logger).
#[macro_export]
macro_rules! log_info {
    ($($line:tt)+) => { $crate::__log_line!(Info, $($line)+) };
}

/// Logs a warning: `log_warn!(logger, "x = {x}")`. See [`Logger`](crate::Logger).
#[macro_export]
macro_rules! log_warn {
    ($($line:tt)+) => { $crate::__log_line!(Warn, $($line)+) };
}

/// Logs an error: `log_error!(logger, "x = {x}")`. See [`Logger`](crate::Logger).
#[macro_export]
macro_rules! log_error {
    ($($line:tt)+) => { $crate::__log_line!(Error, $($line)+) };
}

/// Logs the error that ends the program: `log_fatal!(logger, "x = {x}")`. It does not end it. See
/// [`Logger`](crate::Logger).
#[macro_export]
macro_rules! log_fatal {
    ($($line:tt)+) => { $crate::__log_line!(Fatal, $($line)+) };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __log_line {
    ($level:ident, $to:expr, $($text:tt)+) => {{
        static SITE: $crate::LogSite =
            $crate::LogSite::new(::core::file!(), ::core::line!(), ::core::module_path!());
        let to = &$to;
        let rule = $crate::LogTo::log_rule(to);
        let level = $crate::args::LogLevel::$level;
        if SITE.passes(level, &rule) {
            SITE.log(level, &rule, ::core::format_args!($($text)+));
        }
    }};
}
