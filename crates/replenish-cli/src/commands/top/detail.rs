//! One worker: its handles, the histogram of its responses, and its last second as lanes.

use super::canvas::{Line, Style};
use super::reading::Row;
use super::screen::{bar, ms, percent};
use crate::time::Nanos;
use replenish_recorder::{Event, Kind};
use std::collections::BTreeMap;

/// Lanes show this much.
const SPAN: Nanos = 1_000_000_000;
/// Handles that are shown.
const MOST: usize = 64;

/// A callback that has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Call {
    name: u32,
    due: Nanos,
    begin: Nanos,
    end: Nanos,
}

/// The recording of one worker.
pub(super) struct Recorded<'a> {
    pub(super) events: &'a [Event],
    /// Events of its budget.
    pub(super) budget: &'a [Event],
    pub(super) name: &'a dyn Fn(u32) -> String,
}

/// The figures of a handle.
#[derive(Default)]
struct Handle {
    calls: u64,
    sum: Nanos,
    took: Vec<Nanos>,
    worst_latency: Nanos,
    worst_response: Nanos,
    late: u64,
}

/// Callbacks with both ends in the recording, in the order of their ends.
fn calls(events: &[Event]) -> Vec<Call> {
    let mut open: Option<(u32, Nanos)> = None;
    let mut calls = Vec::new();
    for event in events {
        match event.kind {
            Kind::Begin => open = Some((event.name, event.time)),
            Kind::Gap => open = None,
            Kind::End => {
                let begun = open.take().filter(|(name, _)| *name == event.name);
                calls.extend(begun.map(|(name, begin)| Call {
                    name,
                    due: event.a,
                    begin,
                    end: event.time,
                }));
            }
            _ => {}
        }
    }
    calls
}

/// The whole screen, at most `height` lines.
pub(super) fn draw(
    row: &Row,
    recorded: &Recorded<'_>,
    (width, height): (usize, usize),
) -> Vec<Line> {
    let calls = calls(recorded.events);
    let mut lines = head(row);
    handles(&calls, recorded, &mut lines);
    histogram(&calls, width, &mut lines);
    lanes(&calls, recorded, width, &mut lines);
    lines.truncate(height.saturating_sub(1));
    lines.push(Line::of(Style::Dim, "esc back  t trace  p pause  q quit"));
    lines.truncate(height);
    lines
        .into_iter()
        .map(|line| line.fit(width, None))
        .collect()
}

fn head(row: &Row) -> Vec<Line> {
    let mut first = Line::of(Style::Bold, format!("{}  {}", row.program, row.worker));
    let cpu = row.cpu.map_or("any CPU".into(), |cpu| format!("CPU {cpu}"));
    first.add(
        Style::Plain,
        format!("  pid {}  {cpu}  {}", row.pid, row.policy),
    );
    let mut lines = vec![first];
    if let Some((budget, period)) = row.budget {
        let left = row.available as f64 / budget.max(1) as f64;
        let mut line = Line::of(Style::Plain, "left ");
        line.add(
            if row.low { Style::Warn } else { Style::Good },
            bar(left, 20),
        );
        let text = format!(
            " {} of {} ms every {} ms, used up {} times, now at {} priority",
            ms(row.available),
            ms(budget),
            ms(period),
            row.exhaustions,
            if row.low { "background" } else { "high" }
        );
        line.add(Style::Plain, text);
        lines.push(line);
    }
    lines.push(Line::default());
    lines
}

fn handles(calls: &[Call], recorded: &Recorded<'_>, lines: &mut Vec<Line>) {
    let mut all: BTreeMap<u32, Handle> = BTreeMap::new();
    for call in calls {
        let handle = all.entry(call.name).or_default();
        let took = call.end.saturating_sub(call.begin);
        handle.calls += 1;
        handle.sum = handle.sum.saturating_add(took);
        handle.took.push(took);
        handle.worst_latency = handle
            .worst_latency
            .max(call.begin.saturating_sub(call.due));
        handle.worst_response = handle.worst_response.max(call.end.saturating_sub(call.due));
    }
    for miss in recorded.events.iter().filter(|e| e.kind == Kind::Miss) {
        if let Some(handle) = all.get_mut(&miss.name) {
            handle.late += 1;
        }
    }
    let first = calls.first().map_or(0, |c| c.begin);
    let span = calls.last().map_or(0, |c| c.end.saturating_sub(first));
    let heading = format!(
        "{:<28} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>5}  in the last {} ms",
        "HANDLE",
        "CALLS",
        "PER s",
        "MEAN ms",
        "99 % ms",
        "MAX ms",
        "LATENCY",
        "RESPONSE",
        "LATE",
        ms(span)
    );
    lines.push(Line::of(Style::Bold, heading));
    for (name, mut handle) in all.into_iter().take(MOST) {
        handle.took.sort_unstable();
        let rank = (handle.took.len() * 99).div_ceil(100).max(1) - 1;
        let at = |n: usize| handle.took.get(n).copied().unwrap_or(0);
        let rate = handle.calls as f64 * 1e9 / span.max(1) as f64;
        let (p99, max) = (at(rank), at(handle.took.len().saturating_sub(1)));
        let text: String = (recorded.name)(name).chars().take(28).collect();
        let mut line = Line::of(
            Style::Plain,
            format!(
                "{text:<28} {:>7} {rate:>8.1} {:>8} {:>8} {:>8} {:>8} {:>8} ",
                handle.calls,
                ms(handle.sum / handle.calls.max(1)),
                ms(p99),
                ms(max),
                ms(handle.worst_latency),
                ms(handle.worst_response),
            ),
        );
        let style = if handle.late > 0 {
            Style::Bad
        } else {
            Style::Plain
        };
        line.add(style, format!("{:>5}", handle.late));
        lines.push(line);
    }
    lines.push(Line::default());
}

/// From release to end, by halves of a decade.
fn histogram(calls: &[Call], width: usize, lines: &mut Vec<Line>) {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for call in calls {
        let response = call.end.saturating_sub(call.due).max(1);
        *counts.entry(response.ilog2()).or_default() += 1;
    }
    let Some((first, last)) = counts
        .keys()
        .next()
        .copied()
        .zip(counts.keys().next_back().copied())
    else {
        lines.push(Line::of(
            Style::Dim,
            "no callback has ended in this recording",
        ));
        return;
    };
    let most = counts.values().copied().max().unwrap_or(1);
    lines.push(Line::of(Style::Bold, "RESPONSE, from release to end"));
    let first = first.max(last.saturating_sub(11));
    for octave in first..=last {
        let count: usize = if octave == first {
            counts.range(..=octave).map(|(_, count)| count).sum()
        } else {
            counts.get(&octave).copied().unwrap_or(0)
        };
        let upper = 2_u64
            .checked_shl(octave)
            .filter(|n| *n > 1)
            .unwrap_or(u64::MAX);
        let cells = width.saturating_sub(34).clamp(4, 40);
        let mut line = Line::of(Style::Plain, format!("  below {:>9} ms ", ms(upper)));
        let filled = bar(count as f64 / most as f64, cells);
        line.add(Style::Good, filled.replace('░', " "));
        line.add(Style::Plain, format!(" {count:>6}"));
        lines.push(line);
    }
    lines.push(Line::default());
}

/// The last second: when each callback ran, and when the budget was used up.
fn lanes(calls: &[Call], recorded: &Recorded<'_>, width: usize, lines: &mut Vec<Line>) {
    let newest = recorded
        .events
        .iter()
        .chain(recorded.budget)
        .map(|e| e.time)
        .max();
    let Some(end) = newest.filter(|_| !calls.is_empty()) else {
        return;
    };
    let (label, start) = (24, end.saturating_sub(SPAN));
    let cells = width.saturating_sub(label + 4).clamp(8, 200);
    let cell = SPAN / cells as u64;
    lines.push(Line::of(
        Style::Bold,
        format!("THE LAST SECOND, {} ms a cell", ms(cell)),
    ));
    let mut names: Vec<u32> = calls
        .iter()
        .filter(|c| c.end >= start)
        .map(|c| c.name)
        .collect();
    names.sort_unstable();
    names.dedup();
    for name in names.into_iter().take(MOST) {
        let own = calls.iter().filter(|c| c.name == name);
        let spans = own.map(|c| (c.begin.max(c.due), c.end));
        let lane = lane(spans, start, cell, cells);
        let text: String = (recorded.name)(name).chars().take(label).collect();
        let mut line = Line::of(Style::Plain, format!("{text:<label$} ▕"));
        line.add(Style::Good, lane);
        line.add(Style::Plain, "▏");
        lines.push(line);
    }
    if !recorded.budget.is_empty() {
        let low = lows(recorded.budget, end);
        let mut line = Line::of(Style::Plain, format!("{:<label$} ▕", "budget used up"));
        line.add(Style::Warn, lane(low.iter().copied(), start, cell, cells));
        line.add(Style::Plain, "▏");
        lines.push(line);
        let share: Nanos = low
            .iter()
            .map(|(from, to)| to.saturating_sub((*from).max(start)))
            .sum();
        let text = format!(
            "{} of the second at the low level",
            percent(share as f64 / SPAN as f64)
        );
        lines.push(Line::of(Style::Dim, text));
    }
}

/// The stretches at the low level; one that goes on ends with the recording.
fn lows(budget: &[Event], end: Nanos) -> Vec<(Nanos, Nanos)> {
    let mut all = Vec::new();
    let mut since = None;
    for event in budget.iter().filter(|e| e.kind == Kind::Level) {
        match (event.a, since) {
            (1, None) => since = Some(event.time),
            (0, Some(from)) => {
                all.push((from, event.time));
                since = None;
            }
            _ => {}
        }
    }
    all.extend(since.map(|from| (from, end)));
    all
}

/// Cells by how much of each is covered.
fn lane(
    spans: impl Iterator<Item = (Nanos, Nanos)>,
    start: Nanos,
    cell: Nanos,
    cells: usize,
) -> String {
    let mut covered = vec![0_u64; cells];
    let cell = cell.max(1);
    for (from, to) in spans {
        let (from, to) = (from.max(start) - start, to.max(start) - start);
        let first = usize::try_from(from / cell).unwrap_or(cells);
        let last = usize::try_from(to / cell).unwrap_or(cells);
        for (n, sum) in covered
            .iter_mut()
            .enumerate()
            .take(last.saturating_add(1))
            .skip(first)
        {
            let begin = n as u64 * cell;
            let part = to
                .min(begin.saturating_add(cell))
                .saturating_sub(from.max(begin));
            *sum = sum.saturating_add(part.max(1)); // the shortest is seen, too
        }
    }
    let draw = |sum: &u64| match *sum {
        0 => '·',
        sum if sum < cell / 3 => '░',
        sum if sum < cell / 3 * 2 => '▓',
        _ => '█',
    };
    covered.iter().map(draw).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(time: Nanos, kind: Kind, name: u32, a: u64) -> Event {
        Event {
            time,
            kind,
            name,
            a,
            b: 0,
        }
    }

    #[test]
    fn callbacks_have_both_ends() {
        let events = [
            event(5, Kind::End, 1, 2),
            event(10, Kind::Begin, 1, 8),
            event(15, Kind::End, 1, 8),
            event(20, Kind::Begin, 2, 20),
        ];
        let call = Call {
            name: 1,
            due: 8,
            begin: 10,
            end: 15,
        };
        assert_eq!(calls(&events), [call]);
    }

    #[test]
    fn lanes_are_as_long_as_they_are_covered() {
        let spans = [(0, 10), (25, 30), (31, 32), (55, 1000)];
        assert_eq!(lane(spans.into_iter(), 0, 10, 7), "█░▓░·▓█");
        assert_eq!(lane([(0, u64::MAX)].into_iter(), 5, 10, 3), "███");
    }

    #[test]
    fn any_recording_fits_any_screen() {
        let wild = [0, 1, 1 << 33, u64::MAX];
        let mut events = Vec::new();
        for (n, time) in wild.into_iter().cycle().take(400).enumerate() {
            let kind = Kind::ALL[n % Kind::ALL.len()];
            let begin = event(time, Kind::Begin, n as u32 % 70, wild[n % 4]);
            let end = event(wild[n / 3 % 4], Kind::End, n as u32 % 70, wild[n / 5 % 4]);
            events.extend([begin, end, event(time, kind, 3, wild[n / 2 % 4])]);
        }
        let row = Row {
            budget: Some((u64::MAX, 1)),
            available: u64::MAX,
            ..Row::default()
        };
        let name = |id: u32| format!("handle \x1b[2J {id}");
        for size in [(0, 0), (1, 1), (30, 8), (80, 24), (300, 200)] {
            let recorded = Recorded {
                events: &events,
                budget: &events,
                name: &name,
            };
            let lines = draw(&row, &recorded, size);
            assert!(lines.len() <= size.1);
            assert!(
                lines
                    .iter()
                    .all(|l| l.width() <= size.0 && !l.plain().contains('\x1b'))
            );
        }
    }
}
