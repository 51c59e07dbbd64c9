//! The thread that takes lines to the console and to `/rosout`: an ordinary one, which may wait for
//! a console. It allocates for lines about the log itself alone.

use super::core::{Core, LINES, Target};
use super::foreign;
use super::site::site;
use crate::handoff::{LINE_TEXT, LineHead, LineReader, read_line};
use crate::platform::wall_clock;
use core::sync::atomic::Ordering;
use replenish_args::{ConsoleFormat, LogLevel, LogLine};
use replenish_interfaces::rcl_interfaces::msg::LogView;
use replenish_msg::builtin_interfaces::Time;
use std::format;
use std::io::{self, IsTerminal, Write};
use std::string::String;

/// The logger of lines about the log.
const OWN: &str = "replenish.log";
/// The longest file or module name on `/rosout`; the end of a longer one.
const NAME: usize = 200;

/// The console, and the line that is shown, kept for its room.
pub(super) struct Console {
    format: ConsoleFormat,
    out: String,
}

impl Console {
    /// The format that the variables state; `colours` goes before them.
    pub(super) fn from_env(colours: Option<bool>) -> Self {
        let terminal = |stdout| {
            if stdout {
                io::stdout().is_terminal()
            } else {
                io::stderr().is_terminal()
            }
        };
        let variable = |name: &str| std::env::var(name).ok();
        Self {
            format: ConsoleFormat::read(variable, colours, terminal),
            out: String::with_capacity(1024),
        }
    }

    /// Writes the line. A console that is closed loses it.
    fn show(&mut self, line: &LogLine<'_>) {
        self.out.clear();
        self.format.write(line, &mut self.out);
        let text = self.out.as_bytes();
        if self.format.stdout() {
            io::stdout().lock().write_all(text).ok();
        } else {
            io::stderr().write_all(text).ok();
        }
    }
}

/// Until the log has ended and all lines are written.
pub(super) fn run(core: &Core, console: Option<Console>) {
    let (mut reader, mut room) = (LineReader::default(), [0; LINE_TEXT]);
    let mut writer = Writer {
        core,
        console,
        lost: 0,
        rosout_failed: false,
        name: String::with_capacity(512),
    };
    loop {
        let ended = core.ended.load(Ordering::Acquire);
        while let Some(words) = core.queue.pop(&mut reader) {
            let (head, text) = read_line(&words, &mut room);
            writer.line(head, text);
            core.written.store(reader.taken(), Ordering::Release);
        }
        writer.say_lost();
        if ended {
            return;
        }
        core.notify.wait();
    }
}

struct Writer<'a> {
    core: &'a Core,
    console: Option<Console>,
    /// Lost lines that were said.
    lost: u64,
    /// A publisher's refusal was said.
    rosout_failed: bool,
    /// The name of a line from the facade, kept for its room.
    name: String,
}

impl Writer<'_> {
    fn line(&mut self, head: LineHead, text: &str) {
        let Some(target) = self.core.target(head.logger) else {
            return;
        };
        let level = LogLevel::numbered(head.level.into()).unwrap_or(LogLevel::Info);
        if let Some((from, text)) = foreign::split(head, text) {
            let mut name = core::mem::take(&mut self.name);
            foreign::name(&target.named.name, from, &mut name);
            if self.core.passes(&name, level) {
                let shown = LogLine {
                    stamp: head.stamp,
                    level,
                    name: &name,
                    text,
                    file: "",
                    function: from,
                    line: 0,
                };
                self.show(&shown, &target);
            }
            self.name = name;
            return;
        }
        let site = site(head.site);
        let shown = LogLine {
            stamp: head.stamp,
            level,
            name: &target.named.name,
            text,
            file: site.map_or("", |s| end_of(s.file)),
            function: site.map_or("", |s| end_of(s.module)),
            line: site.map_or(0, |s| s.line),
        };
        self.show(&shown, &target);
    }

    fn show(&mut self, line: &LogLine<'_>, target: &Target) {
        if let Some(console) = &mut self.console {
            console.show(line);
        }
        let Some(rosout) = &target.rosout else {
            return;
        };
        let message = LogView {
            stamp: Time {
                sec: i32::try_from(line.stamp / 1_000_000_000).unwrap_or(i32::MAX),
                nanosec: (line.stamp % 1_000_000_000) as u32,
            },
            level: line.level.number(),
            name: line.name,
            msg: line.text,
            file: line.file,
            function: line.function,
            line: line.line,
        };
        if let Err(e) = rosout.publish_view(&message)
            && !core::mem::replace(&mut self.rosout_failed, true)
        {
            let text = format!("a line is not on /rosout: {e}; later ones are not mentioned");
            self.own(&text);
        }
    }

    fn say_lost(&mut self) {
        let lost = self.core.lost.load(Ordering::Relaxed);
        let new = lost - self.lost;
        if new == 0 {
            return;
        }
        self.lost = lost;
        let text = format!("{new} lines are lost: {LINES} others waited to be written");
        self.own(&text);
    }

    /// A line about the log itself; on `/rosout`, too, if it can be.
    fn own(&mut self, text: &str) {
        let since_1970 = wall_clock().unwrap_or_default().as_nanos();
        let shown = LogLine {
            stamp: u64::try_from(since_1970).unwrap_or(u64::MAX),
            level: LogLevel::Warn,
            name: OWN,
            text,
            file: file!(),
            function: module_path!(),
            line: line!(),
        };
        if let Some(target) = self.core.target(0) {
            self.show(&shown, &target);
        }
    }
}

fn end_of(name: &'static str) -> &'static str {
    let from = name.len().saturating_sub(NAME);
    name.get(from..).unwrap_or_default()
}
