//! Lines of the `log` facade in the queue: the target stands before the text.

use crate::handoff::LineHead;
use std::string::String;

/// The number of the place in the source that stands for the facade.
pub(super) const SITE: u16 = u16::MAX - 1;
/// Separator of target and text.
pub(super) const BETWEEN: char = '\u{1f}';
/// The target of a line from the facade, and its text.
pub(super) fn split(head: LineHead, text: &str) -> Option<(&str, &str)> {
    text.split_once(BETWEEN).filter(|_| head.site == SITE)
}

/// The name of the logger `node` for a target, `robot.arm.serialport.posix`, into `name`.
pub(super) fn name(node: &str, target: &str, name: &mut String) {
    name.clear();
    name.push_str(node);
    for part in target.split("::") {
        name.push('.');
        name.push_str(part);
    }
}
