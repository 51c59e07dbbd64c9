//! `replenish trace`: the last seconds of a program that runs, or of one that was killed.
//!
//! ```text
//!   its file ─► events of each thread and budget ─► tracks ─► perfetto ─► OUT
//!             └─ picture ─► SVG                 └─ ctf ─► DIR   └─ protobuf
//! ```

mod ctf;
mod perfetto;
mod picture;
mod protobuf;
mod recorded;
mod tracks;

use crate::live::{ChainJson, Program, select};
use crate::options::{self, JsonOption};
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::time::Nanos;
use ctf::Stream;
use perfetto::Trace;
use recorded::{Recorded, record};
use replenish_os::live::clocks;
use replenish_recorder::{Event, Source, copy};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Options of `trace`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The program: its name, its process id, or its file (also of a program that was killed), or
    /// the file of a board. Several stand on one timeline (with `--perfetto` and `--svg` only).
    #[arg(value_name = "PROGRAM|FILE", required = true, num_args = 1..)]
    programs: Vec<String>,

    /// Write a Perfetto trace to this file: open it in <https://ui.perfetto.dev>.
    #[arg(long, value_name = "OUT", required_unless_present_any = ["ctf", "dump", "svg"])]
    perfetto: Option<PathBuf>,

    /// Write CTF with the names of ROS 2's tracepoints to this directory, which is made:
    /// babeltrace2, `tracetools_analysis` and Trace Compass read it.
    #[arg(long, value_name = "DIR")]
    ctf: Option<PathBuf>,

    /// Draw the end of the recording into this file: when each callback ran, and what its budget
    /// had left.
    #[arg(long, value_name = "OUT.svg")]
    svg: Option<PathBuf>,

    /// Write the recording itself to this file, as it is at this moment: `trace` and `why` read it
    /// later, and elsewhere.
    #[arg(long, value_name = "OUT")]
    dump: Option<PathBuf>,

    /// Only the end of the recording: 5s, 200ms. Without it, all that is there. Of several, the
    /// time before the last event of any.
    #[arg(long, value_name = "TIME", value_parser = options::last)]
    last: Option<Nanos>,

    #[command(flatten)]
    json: JsonOption,
}

/// One ring in `--json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct RingJson {
    thread: String,
    /// `thread` or `budget`.
    ring: &'static str,
    /// Events of the recording, before `--last`.
    read: u64,
    overwritten: u64,
    torn: u64,
    /// Events in the trace.
    events: usize,
}

/// `trace --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Json {
    program: String,
    pid: u32,
    alive: bool,
    /// From the first event in the trace to the last.
    span_ns: Nanos,
    rings: Vec<RingJson>,
    /// Since the start of the program.
    chains: Vec<ChainJson>,
    /// The other programs on the timeline.
    others: Vec<Json>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if args.programs.len() > 1 && (args.ctf.is_some() || args.dump.is_some()) {
        return Err(Failure::refused(
            "--ctf and --dump take one program; several stand together with --perfetto and --svg only",
        ));
    }
    let programs: Result<Vec<Program>, Failure> =
        args.programs.iter().map(|name| select(name)).collect();
    let programs = programs?;
    let outs = [&args.perfetto, &args.dump, &args.svg, &args.json.json];
    for out in outs.into_iter().flatten() {
        // Emptied, it would be lost, and a program that maps it would end by a signal.
        if programs.iter().any(|program| program.is_at(out)) {
            return Err(at(
                out,
                "it is the recording that is read: name another file",
            ));
        }
    }
    for out in outs {
        files::check_writable(out.as_deref())?;
    }
    if let (Some(out), [program, ..]) = (&args.dump, &*programs) {
        dump(program, out)?;
    }
    let mut all: Vec<Vec<Recorded>> = programs.iter().map(record).collect();
    if let Some(part) = args.last {
        keep(&mut all, part);
    }
    let each = || programs.iter().zip(&all);
    let summaries = || each().map(|(program, recorded)| summary(program, recorded));
    if let Some(out) = &args.perfetto {
        let mut trace = Trace::default();
        each().for_each(|(program, recorded)| encode(&mut trace, program, recorded));
        let bytes = trace.into_bytes();
        std::fs::write(out, &bytes).map_err(|e| at(out, e))?;
        print(&summaries().collect::<Vec<_>>(), out, bytes.len());
    }
    if let Some(out) = &args.svg {
        let drawn: Vec<_> = each()
            .map(|(program, recorded)| (program, &**recorded))
            .collect();
        files::write(out, &picture::draw(&drawn, args.last))?;
        println!("{}", out.display());
    }
    if let (Some(out), Some((program, recorded))) = (&args.ctf, each().next()) {
        write_ctf(program, recorded, out)?;
    }
    let mut summaries = summaries();
    let Some(mut json) = summaries.next() else {
        return Ok(());
    };
    json.others = summaries.collect();
    files::write_json(args.json.json.as_deref(), "trace", &json)
}

/// Makes the directory, so that nothing else is in it.
fn write_ctf(program: &Program, recorded: &[Recorded], out: &Path) -> Outcome {
    let view = &program.view;
    let names = view.names(&program.source);
    let streams = view.threads.iter().zip(recorded);
    let streams: Vec<Stream<'_>> = streams
        .map(|(thread, recorded)| Stream {
            tid: thread.tid,
            name: &thread.name,
            events: &recorded.events,
        })
        .collect();
    let ctf = ctf::encode(view.pid, view.clocks, &names, &streams);
    std::fs::create_dir(out).map_err(|e| at(out, e))?;
    let write = |name: String, bytes: &[u8]| {
        let path = out.join(name);
        std::fs::write(&path, bytes).map_err(|e| at(&path, e))
    };
    write("metadata".into(), ctf.metadata.as_bytes())?;
    for (n, stream) in ctf.streams.iter().enumerate() {
        write(format!("thread-{n}"), stream)?;
    }
    println!(
        "{} (pid {}): {} callbacks in {}. Read it with babeltrace2 or tracetools_analysis",
        view.program,
        view.pid,
        ctf.callbacks,
        out.display()
    );
    Ok(())
}

/// The time of every event.
fn times(recorded: &[Recorded]) -> impl Iterator<Item = Nanos> {
    let all = recorded.iter();
    let all = all.flat_map(|recorded| recorded.events.iter().chain(&recorded.budget));
    all.map(|event| event.time)
}

/// Keeps the end of the recordings: `part` before the last event of any.
fn keep(all: &mut [Vec<Recorded>], part: Nanos) {
    let end = all.iter().flat_map(|one| times(one)).max().unwrap_or(0);
    let from = end.saturating_sub(part);
    for each in all.iter_mut().flatten() {
        each.events.retain(|e| e.time >= from);
        each.budget.retain(|e| e.time >= from);
    }
}

/// Writes a Perfetto trace of the last part of a recording.
pub(crate) fn save(file: &Path, out: &Path, part: Nanos) -> Outcome {
    let program = Program::open(file).map_err(|e| at(file, e))?;
    let mut all = [record(&program)];
    keep(&mut all, part);
    let mut trace = Trace::default();
    let [recorded] = &all;
    encode(&mut trace, &program, recorded);
    std::fs::write(out, trace.into_bytes()).map_err(|e| at(out, e))
}

fn at(path: &Path, error: impl std::fmt::Display) -> Failure {
    Failure::refused(format!("{}: {error}", path.display()))
}

/// Copies the recording while its program goes on.
fn dump(program: &Program, out: &Path) -> Outcome {
    files::replace(out, |path| copy_to(program, path))?;
    println!(
        "{} (pid {}): {} bytes in {}.",
        program.view.program,
        program.view.pid,
        program.source.bytes(),
        out.display()
    );
    Ok(())
}

fn copy_to(program: &Program, out: &Path) -> Outcome {
    let file = File::create(out).map_err(|e| at(out, e))?;
    let (mut written, mut end) = (Ok(()), 0);
    let copied = copy(&program.source, |offset, bytes| {
        end = end.max(offset + bytes.len() as u64);
        written = file.write_all_at(bytes, offset);
        written.is_ok()
    });
    written.map_err(|e| at(out, e))?;
    copied.map_err(|e| at(&program.path, e))?;
    // Its header states the length, pages at the end included.
    file.set_len(end.max(program.source.bytes()))
        .map_err(|e| at(out, e))
}

fn encode(trace: &mut Trace, program: &Program, recorded: &[Recorded]) {
    let view = &program.view;
    let mut snapshots = vec![view.clocks];
    if program.alive {
        snapshots.push(clocks()); // the same boot
    }
    let names = view.names(&program.source);
    let name = |id: u32| match names.get(id as usize) {
        Some(Some((_, name))) => name.clone(),
        _ if id == 0 => String::new(),
        _ => format!("#{id}"),
    };
    let threads: Vec<Vec<Event>> = recorded.iter().map(|r| r.events.clone()).collect();
    let flows = tracks::flows(&threads);
    trace.program(view.pid, &snapshots);
    let process = trace.process(view.pid, &view.program);
    for ((n, thread), recorded) in (1..).zip(&view.threads).zip(recorded) {
        // A thread that has not begun has no id, and needs one of its own here.
        let tid = if thread.tid == 0 {
            u64::from(view.pid) + n
        } else {
            thread.tid
        };
        let track = trace.thread(process, view.pid, tid, &thread.name);
        let [left, levels, points] = tracks::of_budget(&recorded.budget, thread.totals.is_low);
        trace.entries(track, &tracks::of_thread(&recorded.events, name, &flows));
        trace.entries(track, &points);
        if thread.budget.is_some() {
            let counter = trace.counter(process, &format!("{}: budget left", thread.name));
            trace.entries(counter, &left);
            let state = trace.state(process, &format!("{}: level", thread.name));
            trace.entries(state, &levels);
        }
    }
}

fn summary(program: &Program, recorded: &[Recorded]) -> Json {
    let view = &program.view;
    let begin = times(recorded).min().unwrap_or(0);
    let span_ns = times(recorded).max().unwrap_or(0) - begin;
    let mut rings = Vec::new();
    for (thread, recorded) in view.threads.iter().zip(recorded) {
        let budget = thread.budget.map(|_| ("budget", &recorded.budget));
        let both = [Some(("thread", &recorded.events)), budget];
        for (ring, copied) in both.into_iter().zip(recorded.copied) {
            rings.extend(ring.map(|(ring, events)| RingJson {
                thread: thread.name.clone(),
                ring,
                read: copied.read,
                overwritten: copied.overwritten,
                torn: copied.torn,
                events: events.len(),
            }));
        }
    }
    Json {
        program: view.program.clone(),
        pid: view.pid,
        alive: program.alive,
        span_ns,
        rings,
        chains: view.chains.iter().map(ChainJson::of).collect(),
        others: Vec::new(),
    }
}

fn print(all: &[Json], out: &Path, bytes: usize) {
    for json in all {
        let events: usize = json.rings.iter().map(|r| r.events).sum();
        println!(
            "{} (pid {}, {}): {events} events of {:.3} s",
            json.program,
            json.pid,
            if json.alive { "running" } else { "ended" },
            json.span_ns as f64 / 1e9,
        );
        let torn: u64 = json.rings.iter().map(|r| r.torn).sum();
        if torn > 0 {
            println!("{torn} records made no sense: the file was damaged.");
        }
    }
    println!(
        "{} ({bytes} bytes). Open it in https://ui.perfetto.dev",
        out.display()
    );
}
