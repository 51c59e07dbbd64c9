//! The kernel's trace as text: what one line says.

use crate::load::Nanos;

/// The real-time priority behind the kernel's number: 0 is FIFO 99, 98 is FIFO 1, less a deadline.
pub(super) fn rank(priority: i64) -> u8 {
    match priority {
        ..0 => 100,
        0..=98 => u8::try_from(99 - priority).unwrap_or(0),
        _ => 0,
    }
}

/// The CPU in square brackets; a thread's name may have some as well, so the last ones count.
pub(super) fn on_cpu(head: &str) -> Option<usize> {
    let (_, from) = head.rsplit_once('[')?;
    from.split_once(']')?.0.parse().ok()
}

/// Whether the line was written by this thread: `w [000]-9 [001] d..2. 12.000150`.
pub(super) fn is_of(head: &str, thread: i64) -> bool {
    let writer = head.rsplit_once('[').map_or("", |(writer, _)| writer);
    let id = writer.trim_end().rsplit_once('-').map(|(_, id)| id.parse());
    id == Some(Ok(thread))
}

/// Of a line about the handler of an interrupt: whether it is a soft one, whether it begins, and
/// the line's head.
pub(super) fn handler(line: &str) -> Option<(bool, bool, &str)> {
    let find = |soft, begins, key| {
        let head = line.split_once(key).map(|(head, _)| head);
        head.map(|head| (soft, begins, head))
    };
    find(false, true, ": irq_handler_entry: ")
        .or_else(|| find(false, false, ": irq_handler_exit: "))
        .or_else(|| find(true, true, ": softirq_entry: "))
        .or_else(|| find(true, false, ": softirq_exit: "))
}

/// Whether the line was written in an interrupt: `[001] dNh2. 12.345678`.
pub(super) fn is_interrupt(head: &str) -> bool {
    let flags = head.rsplit_once("] ").map_or("", |(_, rest)| rest);
    let flags = flags.split_whitespace().next().unwrap_or("");
    flags.contains(['h', 'H'])
}

/// Whether a thread of this name, with a space or its number behind it, is a worker or an enforcer:
/// pinned, and at a priority that only the enforcer changes.
pub(super) fn is_of_a_case(comm: &str) -> bool {
    let worker = comm.strip_prefix('w');
    let worker = worker.and_then(|rest| rest.split_once([' ', '-']));
    comm.starts_with("enforcer")
        || worker.is_some_and(|(number, _)| number.bytes().all(|b| b.is_ascii_digit()))
}

/// The address of a timer, and the function that it calls.
pub(super) fn timer(text: &str) -> Option<(String, &str)> {
    let (address, rest) = text.strip_prefix("hrtimer=")?.split_once(" function=")?;
    Some((address.to_string(), rest.split_once(' ')?.0))
}

/// The time stamp that ends the head, in ns.
pub(super) fn time(head: &str) -> Option<Nanos> {
    let (seconds, fraction) = head.rsplit_once(' ')?.1.split_once('.')?;
    let micros: Nanos = fraction.parse().ok()?;
    Some(seconds.parse::<Nanos>().ok()? * 1_000_000_000 + micros * 1000)
}

/// The number at the beginning, with or without `0x`.
pub(super) fn hexadecimal(text: &str) -> Option<i32> {
    let text = text.strip_prefix("0x").unwrap_or(text);
    let end = text.find(|c: char| !c.is_ascii_hexdigit());
    i32::from_str_radix(text.get(..end.unwrap_or(text.len()))?, 16).ok()
}

/// The number after the last such key: names may contain anything, and stand in front.
pub(super) fn number(text: &str, key: &str) -> Option<i64> {
    let (_, value) = text.rsplit_once(key)?;
    let end = value.find(|c: char| c != '-' && !c.is_ascii_digit());
    value.get(..end.unwrap_or(value.len()))?.parse().ok()
}
