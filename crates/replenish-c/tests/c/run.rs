//! Programs that run: each budget's CPU time against the budget, and refusals without privilege.

use crate::build::{
    COMPILERS, EXAMPLES, Example, Link, build, install, missing, run, side_by_side,
};
use replenish_recorder::{Event, Kind, View};
use replenish_testkit::harness::{Trial, peer_trial, rt_trial};
use std::path::{Path, PathBuf};
use std::process::Command;

const MS: u64 = 1_000_000;

/// One line of an example's report.
#[derive(Debug)]
struct Row {
    name: String,
    amount: u64,
    period: u64,
    elapsed: u64,
    at_priority: u64,
    exhaustions: u64,
}

fn rows(text: &str) -> Vec<Row> {
    let rows = text
        .lines()
        .filter(|line| line.contains(" at_priority_ns "));
    rows.map(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let of = |name: &str| {
            let place = words.iter().position(|word| *word == name).unwrap();
            words[place + 1].parse().unwrap()
        };
        Row {
            name: words[0].into(),
            amount: of("amount_ns"),
            period: of("period_ns"),
            elapsed: of("elapsed_ns"),
            at_priority: of("at_priority_ns"),
            exhaustions: of("exhaustions"),
        }
    })
    .collect()
}

/// In memory, as recordings must be.
fn recordings() -> PathBuf {
    PathBuf::from(format!("/dev/shm/replenish-c-{}", std::process::id()))
}

/// The marks of semantics.cpp as others read them: 32 threads, three marks of each.
fn recorded() {
    let mut files = std::fs::read_dir(recordings()).unwrap();
    let path = files.next().unwrap().unwrap().path();
    let bytes = std::fs::read(path).unwrap();
    let view = View::read(&*bytes).unwrap();
    assert!(view.program.starts_with("semantics-"), "{view:?}");
    let names = view.names(&*bytes);
    let mut marking = view.threads.iter().filter(|thread| thread.tid != 0);
    for n in 0..32 {
        let thread = marking.next().unwrap();
        assert_eq!(thread.name, format!("marks-{n}"));
        let (events, copied) = thread.events(&*bytes);
        assert_eq!((copied.torn, copied.overwritten), (0, 0));
        let said = |event: &Event| {
            let name = names.get(event.name as usize).cloned().flatten();
            (event.kind, name.map(|(_, name)| name), event.a)
        };
        let wanted = [("begun", n), ("done", n * n), ("begun", n)];
        let wanted = wanted.map(|(name, a)| (Kind::Mark, Some(name.to_owned()), a));
        assert_eq!(events.iter().map(said).collect::<Vec<_>>(), wanted);
    }
    assert!(marking.next().is_none());
    std::fs::remove_dir_all(recordings()).unwrap();
}

/// Runs a program for `seconds` on the last CPU, with a deployment file; its output.
fn on_last_cpu(program: &Path, seconds: f64, overlay: Option<&Path>) -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let mut lines = status.lines();
    let list = lines.find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    let cpu = list.unwrap().trim().rsplit([',', '-']).next().unwrap();
    run(Command::new(program)
        .env("REPLENISH_LEDGER", "off")
        .env("REPLENISH_LIVE", recordings())
        .envs(overlay.map(|file| ("REPLENISH_OVERLAY", file)))
        .args([&seconds.to_string(), cpu]))
}

/// The rows of a program, each within its budget. Each has work for all of the time: in some run of
/// thirty, in which the machine does not stand still, each gets its budget.
fn judged(program: &Path, seconds: f64) -> Vec<Row> {
    for _ in 0..30 {
        let text = on_last_cpu(program, seconds, None);
        eprint!("{text}");
        let rows = rows(&text);
        for row in &rows {
            // One budget in each period that begins within the time, and one at its beginning.
            let most = (row.elapsed / row.period + 1) * row.amount + MS;
            assert!(row.at_priority <= most, "{row:?}");
            assert!(row.exhaustions > 0, "{row:?}");
        }
        let least = |row: &Row| row.elapsed / row.period * row.amount * 9 / 10;
        if rows.iter().all(|row| row.at_priority >= least(row)) {
            return rows;
        }
    }
    panic!("no run in thirty got its budgets");
}

/// Under the sanitizers from each compiler, otherwise from one.
fn holds(example: Example, names: &[&str], link: Link) {
    let most = if link == Link::Checked { 2 } else { 1 };
    let available = COMPILERS.into_iter().filter(|c| missing(c.1).is_none());
    let compilers: Vec<_> = available.take(most).collect();
    let built = side_by_side(&compilers, |compilers| {
        let tree = install(&format!("run-{}-{link:?}", compilers.0));
        let program = build(&tree, *compilers, example, link);
        (tree, program)
    });
    for (_tree, program) in &built {
        let rows = judged(program, 1.0);
        let found: Vec<&str> = rows.iter().map(|row| row.name.as_str()).collect();
        assert_eq!(found, names);
    }
}

/// Ends, threads of others, many at once, forks, callback groups: see the program. The second time
/// a deployment file has a budget for a group that the program gives none.
fn semantics() {
    let file =
        "[[worker]]\nname = \"planned\"\nguarantee = { budget = \"2 ms\", period = \"20 ms\" }\n";
    let available = COMPILERS.into_iter().filter(|c| missing(c.1).is_none());
    let built = side_by_side(&available.collect::<Vec<_>>(), |compilers| {
        let tree = install(&format!("semantics-{}", compilers.0));
        let source = Example("../crates/replenish-c/tests/programs/semantics.cpp");
        let program = build(&tree, *compilers, source, Link::Checked);
        (tree, program)
    });
    for (tree, program) in &built {
        let parts =
            ["ends", "others", "many", "marks", "forks", "groups"].map(|part| format!("ok {part}"));
        let overlay = tree.path("budgets.toml");
        std::fs::write(&overlay, file).unwrap();
        for overlay in [None, Some(&*overlay)] {
            let text = on_last_cpu(program, 0.0, overlay);
            assert_eq!(text.lines().collect::<Vec<_>>(), parts);
            recorded();
        }
    }
}

/// Without the privilege every example ends with the commands that grant it.
fn unprivileged() {
    let tree = install("unprivileged");
    let programs = side_by_side(&EXAMPLES, |example| {
        build(&tree, COMPILERS[0], *example, Link::Checked)
    });
    for program in &programs {
        let output = Command::new("setpriv")
            .args([
                "--bounding-set=-all",
                "--inh-caps=-all",
                "--reuid=65534",
                "--clear-groups",
            ])
            .arg("--")
            .arg(program)
            // The leak checker attaches to the process, which this user may not.
            .env("ASAN_OPTIONS", "detect_leaks=0")
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.starts_with("privilege missing: "), "{text}");
        assert!(text.contains("setcap"), "{text}");
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    let lacks = || missing("pkg-config").or(missing("g++"));
    let mut trials = vec![peer_trial(
        "without_privilege",
        lacks().or(missing("setpriv")),
        unprivileged,
    )];
    if let Some(why) = lacks() {
        trials.push(peer_trial("budgets_hold", Some(why), || {}));
        return trials;
    }
    let groups: &[&str] = &["control", "planner"];
    let each = [
        ("c", Example("c/budget.c"), &["worker"][..]),
        ("cpp", Example("cpp/budgets.cpp"), groups),
        ("rclc", Example("c/rclc_executors.c"), groups),
        (
            "callback_groups",
            Example("cpp/callback_groups.cpp"),
            groups,
        ),
    ];
    for (name, example, names) in each {
        for link in [Link::Shared, Link::Checked] {
            let name = format!("{name}_holds_its_budget_{link:?}").to_lowercase();
            trials.push(rt_trial(&name, move || holds(example, names, link)));
        }
    }
    trials.push(rt_trial("what_the_headers_promise", semantics));
    trials
}
