//! The screen: totals of the host, and a line for each worker.

use super::canvas::{Line, Style};
use super::reading::{Chain, Cpu, Reading, Row};
use super::state::State;
use crate::time::Nanos;
use std::cmp::Reverse;

/// Cells of a bar.
const BAR: usize = 10;

/// A column: its heading, its width, and how early it makes room on a narrow screen (0: never).
struct Column {
    name: &'static str,
    width: usize,
    leaves: u8,
    /// Numbers are on the right.
    right: bool,
    cell: fn(&Row, Nanos) -> (Style, String),
}

const COLUMNS: [Column; 14] = [
    column("PROGRAM", 16, 0, false, |r, _| plain(&*r.program)),
    column("PID", 7, 8, true, |r, _| plain(r.pid.to_string())),
    column("WORKER", 16, 0, false, |r, _| plain(&*r.worker)),
    column("CPU", 3, 5, true, |r, _| {
        plain(r.cpu.map_or("-".into(), |c| c.to_string()))
    }),
    column("POLICY", 22, 10, false, |r, _| plain(&*r.policy)),
    column("BUDGET/PERIOD ms", 16, 4, true, |r, _| {
        plain(
            r.budget
                .map_or("-".into(), |(b, p)| format!("{}/{}", ms(b), ms(p))),
        )
    }),
    column("USED", 6, 0, true, |r, window| {
        plain(percent(share(r.since.used, window)))
    }),
    column("OF BUDGET", 12, 3, false, of_budget),
    column("LEVEL", 5, 2, false, level),
    column("EXH/s", 6, 1, true, |r, window| {
        let rate = share(r.since.exhaustions.saturating_mul(1_000_000_000), window);
        (
            if rate > 0.0 {
                Style::Warn
            } else {
                Style::Plain
            },
            format!("{rate:.1}"),
        )
    }),
    column("LATE", 5, 1, true, |r, _| counted(r.since.late, Style::Bad)),
    column("LATENCY", 8, 7, true, |r, _| {
        plain(ms(r.since.worst_latency))
    }),
    column("RESPONSE", 8, 6, true, |r, _| {
        plain(ms(r.since.worst_response))
    }),
    column("DROPS", 5, 9, true, |r, _| {
        counted(r.since.drops, Style::Warn)
    }),
];

const fn column(
    name: &'static str,
    width: usize,
    leaves: u8,
    right: bool,
    cell: fn(&Row, Nanos) -> (Style, String),
) -> Column {
    Column {
        name,
        width,
        leaves,
        right,
        cell,
    }
}

fn plain(text: impl Into<String>) -> (Style, String) {
    (Style::Plain, text.into())
}

fn counted(count: u64, style: Style) -> (Style, String) {
    let style = if count > 0 { style } else { Style::Plain };
    (style, count.to_string())
}

fn share(part: u64, window: Nanos) -> f64 {
    if window == 0 {
        0.0
    } else {
        part as f64 / window as f64
    }
}

pub(super) fn percent(share: f64) -> String {
    format!("{:.1}%", share * 100.0)
}

/// Milliseconds, with as many decimals as a short cell has room for.
pub(super) fn ms(time: Nanos) -> String {
    let ms = time as f64 / 1e6;
    match time {
        0..10_000_000 => format!("{ms:.3}"),
        10_000_000..1_000_000_000 => format!("{ms:.1}"),
        _ => format!("{ms:.0}"),
    }
}

/// A bar of `cells` cells.
pub(super) fn bar(share: f64, cells: usize) -> String {
    let full = (share.clamp(0.0, 1.0) * cells as f64).round();
    let full = (0..cells).filter(|n| (*n as f64) < full).count();
    format!("{}{}", "█".repeat(full), "░".repeat(cells - full))
}

/// The used part of the budget that the window brought.
fn of_budget(row: &Row, window: Nanos) -> (Style, String) {
    let Some((budget, period)) = row.budget else {
        return plain("");
    };
    let owed = budget as f64 / period as f64 * window as f64;
    let used = if owed > 0.0 {
        row.since.used as f64 / owed
    } else {
        0.0
    };
    let style = match used {
        x if x > 0.95 => Style::Bad,
        x if x > 0.75 => Style::Warn,
        _ => Style::Good,
    };
    (style, bar(used, BAR))
}

fn level(row: &Row, _: Nanos) -> (Style, String) {
    match (row.alive, row.budget, row.low) {
        (false, ..) => (Style::Dim, "ended".into()),
        (true, None, _) => plain("-"),
        (true, Some(_), false) => (Style::Good, "high".into()),
        (true, Some(_), true) => (Style::Warn, "low".into()),
    }
}

/// The columns that fit, the least important ones left out.
fn columns(width: usize) -> Vec<&'static Column> {
    let mut shown: Vec<&Column> = COLUMNS.iter().collect();
    let needs = |shown: &[&Column]| shown.iter().map(|c| c.width + 1).sum::<usize>();
    while needs(&shown) > width {
        let worst = shown
            .iter()
            .map(|c| c.leaves)
            .max()
            .filter(|leaves| *leaves > 0);
        let Some(worst) = worst else { break };
        shown.retain(|c| c.leaves != worst);
    }
    shown
}

fn cell(column: &Column, style: Style, text: &str, line: &mut Line) {
    let width = column.width;
    let cut: String = if text.chars().count() > width {
        text.chars().take(width - 1).chain(['…']).collect()
    } else {
        text.into()
    };
    let padded = if column.right {
        format!("{cut:>width$} ")
    } else {
        format!("{cut:<width$} ")
    };
    line.add(style, padded);
}

/// The whole screen, at most `height` lines.
pub(super) fn draw(
    state: &mut State,
    reading: &Reading,
    (width, height): (usize, usize),
) -> Vec<Line> {
    let mut lines = header(reading, width, height);
    let shown = columns(width);
    let mut heading = Line::default();
    shown
        .iter()
        .for_each(|c| cell(c, Style::Bold, c.name, &mut heading));
    lines.push(heading);
    let room = room(reading, height);
    let selected = state.settle(&reading.rows, room);
    if reading.rows.is_empty() {
        lines.push(Line::of(
            Style::Dim,
            "No program of replenish runs here, or this account may not read its recording.",
        ));
    }
    for (n, row) in reading.rows.iter().enumerate().skip(state.top).take(room) {
        let mut line = Line::default();
        for column in &shown {
            let (style, text) = (column.cell)(row, reading.window);
            let style = if row.alive { style } else { Style::Dim };
            cell(column, style, &text, &mut line);
        }
        if n == selected {
            line = line.fit(width, Some(Style::Plain));
            line.all(Style::Selected);
        }
        lines.push(line);
    }
    lines.truncate(height.saturating_sub(1));
    lines.push(footer(state, reading));
    lines.truncate(height);
    lines
        .into_iter()
        .map(|line| line.fit(width, None))
        .collect()
}

/// Lines for workers.
pub(super) fn room(reading: &Reading, height: usize) -> usize {
    height
        .saturating_sub(totals(reading, height).len() + chains(reading, height).len() + 3)
        .max(1)
}

/// The CPUs that have something to say first; on a low screen one line for all.
fn totals(reading: &Reading, height: usize) -> Vec<&Cpu> {
    let most = (height / 4).max(1);
    let mut cpus: Vec<&Cpu> = reading.cpus.iter().collect();
    if cpus.len() > most {
        cpus.sort_by(|a, b| {
            (b.reserved, b.busy)
                .partial_cmp(&(a.reserved, a.busy))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        cpus.truncate(most);
        cpus.sort_by_key(|cpu| cpu.number);
    }
    cpus
}

/// The chains with the most instances beyond the limit first; on a low screen one line, or none.
fn chains(reading: &Reading, height: usize) -> Vec<&Chain> {
    let most = height / 6;
    let mut chains: Vec<&Chain> = reading.chains.iter().collect();
    if chains.len() > most {
        chains.sort_by_key(|chain| Reverse((chain.exceeded, chain.worst)));
        chains.truncate(most);
    }
    chains
}

/// A line for a chain.
fn chain(chain: &Chain, window: Nanos, width: usize) -> Line {
    let room = width.saturating_sub(70).clamp(12, 40);
    let name: String = format!("{} ({})", chain.name, chain.program)
        .chars()
        .take(room)
        .collect();
    let mut line = Line::of(Style::Plain, format!("chain {name:<room$} "));
    let rate = share(chain.ended.saturating_mul(1_000_000_000), window);
    line.add(Style::Plain, format!("{rate:>6.1}/s"));
    let or_dash = |time: Option<Nanos>| time.map_or("-".into(), ms);
    line.add(Style::Plain, format!("  longest {:>7}", ms(chain.longest)));
    line.add(
        Style::Plain,
        format!(
            "  worst {:>7} of {:>7} ms",
            or_dash(chain.worst),
            or_dash(chain.limit)
        ),
    );
    let (style, late) = counted(chain.exceeded, Style::Bad);
    line.add(style, format!("  late {late}"));
    if let Some(bound) = chain.bound {
        line.add(Style::Dim, format!("  bound {}", ms(bound)));
    }
    line
}

fn header(reading: &Reading, width: usize, height: usize) -> Vec<Line> {
    let mut first = Line::of(Style::Bold, "replenish top");
    let workers = reading.rows.len();
    first.add(
        Style::Plain,
        format!("  {} programs, {workers} workers", reading.programs),
    );
    if let Some(others) = reading.others {
        let text = format!(
            "; programs without replenish take {} of a CPU",
            percent(others)
        );
        first.add(Style::Dim, text);
    }
    let mut lines = vec![first];
    for cpu in totals(reading, height) {
        let cells = width.saturating_sub(58).clamp(4, 20);
        let mut line = Line::of(Style::Plain, format!("CPU {:<3} ", cpu.number));
        let style = if cpu.busy > 0.95 {
            Style::Bad
        } else {
            Style::Good
        };
        line.add(style, bar(cpu.busy, cells));
        line.add(Style::Plain, format!(" {:>6} busy", percent(cpu.busy)));
        line.add(
            Style::Plain,
            format!("  workers {:>6}", percent(cpu.workers)),
        );
        line.add(
            Style::Plain,
            format!("  reserved {:>6}", percent(cpu.reserved)),
        );
        lines.push(line);
    }
    let chains = chains(reading, height).into_iter();
    lines.extend(chains.map(|one| chain(one, reading.window, width)));
    lines
}

fn footer(state: &State, reading: &Reading) -> Line {
    if !state.notice.is_empty() {
        return Line::of(Style::Bold, state.notice.clone());
    }
    let paused = if state.paused { "paused, " } else { "" };
    let left_out = match reading.warnings.len() {
        0 => String::new(),
        n => format!("  {n} files left out: see --once"),
    };
    Line::of(
        Style::Dim,
        format!("{paused}q quit  ↵ detail  t trace  p pause  sort: n u e l d c{left_out}"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::top::canvas::to_terminal;
    use crate::commands::top::reading::Since;

    /// 40 programs of 32 workers.
    fn full() -> Reading {
        let rows = (0..1280).map(|n| Row {
            key: ("f".into(), n),
            program: format!("program-with-a-long-name-{}", n / 32),
            pid: 4_000_000,
            alive: n % 100 != 99,
            worker: format!("worker{}", n % 32),
            cpu: (n % 2 == 0).then_some(127),
            policy: "sporadic 20 ms every 100 ms, 90 and 10".into(),
            budget: (n % 3 > 0).then_some((20_000_000, 100_000_000)),
            available: 5,
            low: n % 5 == 0,
            exhaustions: n as u64,
            since: Since {
                used: u64::MAX,
                exhaustions: u64::MAX,
                late: u64::MAX,
                drops: u64::MAX,
                callbacks: u64::MAX,
                worst_latency: u64::MAX,
                worst_response: u64::MAX,
            },
        });
        let cpu = |number| Cpu {
            number,
            busy: 1.0,
            workers: 0.5,
            reserved: 0.3,
        };
        let wild = |n: u64| Chain {
            program: "program".repeat(20),
            name: format!("chain-{n}"),
            limit: Some(u64::MAX),
            bound: Some(u64::MAX),
            ended: u64::MAX,
            exceeded: n,
            longest: u64::MAX,
            worst: Some(u64::MAX),
        };
        Reading {
            rows: rows.collect(),
            chains: (0..64).map(wild).collect(),
            cpus: (0..128).map(cpu).collect(),
            others: Some(3.2),
            window: 1_000_000_000,
            programs: 40,
            warnings: vec!["w".into()],
        }
    }

    #[test]
    fn a_screen_of_any_size_is_filled_and_never_exceeded() {
        let reading = full();
        for size in [
            (0, 0),
            (1, 1),
            (10, 3),
            (20, 5),
            (40, 10),
            (80, 24),
            (200, 60),
            (500, 2000),
        ] {
            let mut state = State {
                selected: Some(("f".into(), 1279)),
                ..State::default()
            };
            for rows in [&reading, &Reading::default()] {
                let lines = draw(&mut state, rows, size);
                assert!(lines.len() <= size.1, "{size:?}: {}", lines.len());
                assert!(lines.iter().all(|line| line.width() <= size.0), "{size:?}");
                assert!(to_terminal(&lines, true).len() < 200 * (size.0 + 8) * (size.1 + 1));
            }
        }
        let mut state = State {
            selected: Some(("f".into(), 1279)),
            ..State::default()
        };
        let lines = draw(&mut state, &reading, (80, 24));
        assert_eq!(lines.len(), 24);
        let last = lines[22].plain();
        assert!(
            last.contains("worker31"),
            "the selected one is there: {last}"
        );
        let chains: Vec<_> = lines.iter().map(Line::plain).collect();
        let chains = chains.iter().filter(|line| line.starts_with("chain "));
        let shown: Vec<&str> = chains.map(|line| line[..14].trim()).collect();
        let latest = [
            "chain chain-63",
            "chain chain-62",
            "chain chain-61",
            "chain chain-60",
        ];
        assert_eq!(shown, latest, "those that are late most often");
    }

    #[test]
    fn narrow_screens_keep_the_names_and_the_use() {
        let names = |width| columns(width).iter().map(|c| c.name).collect::<Vec<_>>();
        assert_eq!(names(1000).len(), COLUMNS.len());
        let narrow = names(60);
        assert!(
            narrow.contains(&"WORKER") && narrow.contains(&"USED"),
            "{narrow:?}"
        );
        assert!(!narrow.contains(&"POLICY"), "{narrow:?}");
        assert_eq!(names(0), ["PROGRAM", "WORKER", "USED"]);
    }

    #[test]
    fn bars_and_times_are_as_long_as_their_cells() {
        for share in [-1.0, 0.0, 0.34, 1.0, 7.0, f64::NAN, f64::INFINITY] {
            assert_eq!(bar(share, BAR).chars().count(), BAR);
        }
        assert_eq!(bar(0.3, 10), "███░░░░░░░");
        assert_eq!(
            (ms(1_500_000), ms(150_000_000)),
            ("1.500".into(), "150.0".into())
        );
    }
}
