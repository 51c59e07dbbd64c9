//! The loop: look, draw, wait for a key.

use super::canvas::{Line, to_svg, to_terminal};
use super::detail::{self, Recorded};
use super::reading::{Reader, Reading, Row};
use super::screen;
use super::state::{State, presses};
use crate::commands::trace;
use crate::live::Program;
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::signals::Stop;
use replenish_os::Terminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A signal is noticed this soon.
const SLICE: Duration = Duration::from_millis(100);
/// The trace that a key writes.
const LAST: u64 = 10_000_000_000;

/// Until the user or a signal ends it.
pub(super) fn run(every: Duration, ended: bool) -> Outcome {
    let stop = Stop::on_signals()?;
    let colours = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let gone = |e| Failure::refused(format!("the terminal: {e}"));
    let terminal = Terminal::open().map_err(gone)?;
    let (mut reader, mut state) = (Reader::default(), State::default());
    let mut reading = reader.look(ended);
    let mut next = Instant::now() + every.min(Duration::from_millis(250)); // rates need two looks
    while !state.quit && !stop.is_triggered() {
        let size = terminal.size();
        let lines = lines(&mut state, &mut reading, size);
        terminal
            .write(&to_terminal(&lines, colours))
            .map_err(gone)?;
        let mut buffer = [0; 64];
        let wait = next.saturating_duration_since(Instant::now()).min(SLICE);
        let pressed = match terminal.keys(wait, &mut buffer) {
            Ok(bytes) => presses(bytes),
            Err(_) => break, // there is nobody to tell
        };
        let room = screen::room(&reading, size.1);
        for press in pressed {
            state.press(press, &reading, room);
        }
        if std::mem::take(&mut state.save) {
            state.notice = save(&state, &reading);
        }
        if Instant::now() >= next {
            next = Instant::now() + every;
            if !state.paused {
                reading = reader.look(ended);
            }
        }
    }
    Ok(())
}

/// The screen for people who cannot see it: after two looks, in a file.
pub(super) fn picture(
    out: &Path,
    worker: Option<&str>,
    every: Duration,
    ended: bool,
    columns: usize,
) -> Outcome {
    let mut reader = Reader::default();
    reader.look(ended);
    std::thread::sleep(every);
    let mut reading = reader.look(ended);
    let mut state = State::default();
    if let Some(worker) = worker {
        let found = reading.rows.iter().find(|row| row.worker == worker);
        let why = || Failure::refused(format!("--worker {worker}: no program has such a worker"));
        state.selected = Some(found.ok_or_else(why)?.key.clone());
        state.detail = true;
    }
    let needed = reading.rows.len() + reading.cpus.len() + reading.chains.len() + 3;
    let height = 60.min(needed);
    let size = (columns, if worker.is_some() { 60 } else { height.max(8) });
    let lines = lines(&mut state, &mut reading, size);
    files::write(out, &to_svg(&lines, columns))
}

fn lines(state: &mut State, reading: &mut Reading, size: (usize, usize)) -> Vec<Line> {
    state.sort.sort(&mut reading.rows);
    let row = reading
        .rows
        .iter()
        .find(|row| Some(&row.key) == state.selected.as_ref());
    if let Some(row) = row.filter(|_| state.detail)
        && let Some(lines) = worker(row, size)
    {
        return lines;
    }
    state.detail = false;
    screen::draw(state, reading, size)
}

fn worker(row: &Row, size: (usize, usize)) -> Option<Vec<Line>> {
    let (file, number) = &row.key;
    let program = Program::open(file).ok()?;
    let thread = program.view.threads.get(*number)?;
    let (events, _) = thread.events(&program.source);
    let (budget, _) = thread.budget_events(&program.source);
    let names = program.view.names(&program.source);
    let name = |id: u32| match names.get(id as usize) {
        Some(Some((_, name))) => name.clone(),
        _ => format!("#{id}"),
    };
    let recorded = Recorded {
        events: &events,
        budget: &budget,
        name: &name,
    };
    Some(detail::draw(row, &recorded, size))
}

/// Writes the last seconds of the selected program to the working directory.
fn save(state: &State, reading: &Reading) -> String {
    let row = reading
        .rows
        .iter()
        .find(|row| Some(&row.key) == state.selected.as_ref());
    let Some(row) = row else {
        return String::new();
    };
    let free = |n: &u32| !out(row.pid, *n).exists();
    let Some(out) = (1..1000).find(free).map(|n| out(row.pid, n)) else {
        return "a thousand traces of it are here".into();
    };
    match trace::save(&row.key.0, &out, LAST) {
        Ok(()) => format!("{}: open it in https://ui.perfetto.dev", out.display()),
        Err(e) => format!("{}: {e}", out.display()),
    }
}

fn out(pid: u32, number: u32) -> PathBuf {
    format!("replenish-{pid}-{number}.pftrace").into()
}
