//! The thread that takes lines to the console and to `/rosout`: an ordinary one, so that it may wait
//! for a console. It allocates for lines about the log itself alone.

use super::console::{Console, Shown};
use super::line;
use super::loggers::{Core, LINES, Target};
use super::site::site;
use crate::handoff::LineReader;
use crate::platform::wall_clock;
use core::sync::atomic::Ordering;
use replenish_args::LogLevel;
use replenish_interfaces::rcl_interfaces::msg::LogView;
use replenish_msg::builtin_interfaces::Time;
use std::format;

/// The logger of lines about the log.
const OWN: &str = "replenish.log";
/// The longest file or module name on `/rosout`; the end of a longer one.
const NAME: usize = 200;

/// Until the log has ended and all lines are written.
pub(super) fn run(core: &Core, console: Option<Console>) {
    let (mut reader, mut room) = (LineReader::default(), [0; line::LONGEST]);
    let mut writer = Writer {
        core,
        console,
        lost: 0,
        rosout_failed: false,
    };
    loop {
        let ended = core.ended.load(Ordering::Acquire);
        while let Some(words) = core.queue.pop(&mut reader) {
            if let Some((head, text)) = line::read(&words, &mut room) {
                writer.line(head, text);
            }
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
}

impl Writer<'_> {
    fn line(&mut self, head: line::Head, text: &str) {
        let Some(target) = self.core.target(head.logger) else {
            return;
        };
        let site = site(head.site);
        let shown = Shown {
            stamp: head.stamp,
            level: head.level,
            name: &target.named.name,
            text,
            file: site.map_or("", |s| end_of(s.file)),
            function: site.map_or("", |s| end_of(s.module)),
            line: site.map_or(0, |s| s.line),
        };
        self.show(&shown, &target);
    }

    fn show(&mut self, line: &Shown<'_>, target: &Target) {
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
        let shown = Shown {
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
