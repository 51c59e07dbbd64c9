//! `trace` and `top` as a user runs them, on a real program: while it runs, and after `kill -9`.
//!
//! The trace is read by a decoder of the tests' own; Perfetto's own module reads it in `packages`.

use crate::common::{Scratch, json, run, stderr};
use crate::perfetto::check;
use crate::recorded::{self, Program};
use std::os::unix::fs::symlink;
use std::time::{Duration, Instant};

const MS: Duration = Duration::from_millis(1);

#[test]
#[ignore = "the program that other tests start"]
fn the_program_that_is_looked_at() {
    if recorded::is_this() {
        recorded::program();
    }
}

#[test]
fn a_program_is_seen_while_it_runs_and_after_it_was_killed() {
    let scratch = Scratch::new("live");
    let mut program = Program::start("seen");
    let out = scratch.path("top.json");
    let top = program.wait(&out);
    let [first] = &**top["programs"].as_array().unwrap() else {
        panic!("{top:#}");
    };
    assert_eq!(first["pid"], program.child.id());
    assert_eq!(first["alive"], true);
    let workers = first["workers"].as_array().unwrap();
    let names: Vec<&str> = workers
        .iter()
        .map(|w| w["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["source", "sink", "hungry"]);
    let hungry = &workers[2];
    assert_eq!(hungry["budget_ns"], 2_000_000);
    assert_eq!(hungry["period_ns"], 20_000_000);
    assert!(
        hungry["used_ns"].as_u64().unwrap() > 2_000_000,
        "{hungry:#}"
    );
    assert!(hungry["policy"].as_str().is_some_and(|p| !p.is_empty()));
    assert!(workers[0]["budget_ns"].is_null() && workers[0]["exhaustions"] == 0);

    let pid = program.child.id().to_string();
    let (trace, summary) = (scratch.path("a.pftrace"), scratch.path("trace.json"));
    let [trace_path, summary_path] = [&trace, &summary].map(|p| p.to_str().unwrap());
    for killed in [false, true] {
        if killed {
            program.child.kill().unwrap(); // SIGKILL
            program.child.wait().unwrap();
        }
        let args = [
            "trace",
            &pid,
            "--perfetto",
            trace_path,
            "--json",
            summary_path,
        ];
        // The threads without a budget may not have had the CPU yet.
        let end = Instant::now() + Duration::from_secs(60);
        let summary = loop {
            let output = program.command(&args);
            assert!(output.status.success(), "{}", stderr(&output));
            let summary = json(&summary);
            let sink = summary["rings"].as_array().unwrap().iter();
            let mut sink = sink.filter(|r| r["thread"] == "sink" && r["ring"] == "thread");
            let events = sink.next().map(|r| r["events"].as_u64().unwrap());
            if killed || events >= Some(40) {
                break summary;
            }
            assert!(Instant::now() < end, "{summary:#}");
            std::thread::sleep(20 * MS);
        };
        assert_eq!(summary["alive"], !killed);
        let rings = summary["rings"].as_array().unwrap();
        assert_eq!(rings.len(), 5, "{summary:#}");
        assert!(rings.iter().all(|r| r["torn"] == 0), "{summary:#}");
        let [begun, ended, instants, values, states] = check(&std::fs::read(&trace).unwrap());
        assert!(
            begun >= ended && ended > 10 && instants > 10,
            "{begun} {ended}"
        );
        assert!(values > 5 && states > 3, "{values} {states}");
    }
    let top = program.top(&out);
    assert_eq!(top["programs"][0]["alive"], false);
    // Nothing writes any more: the trace's summary says the same of the chain.
    assert_eq!(top["programs"][0]["chains"], json(&summary)["chains"]);
    let [pipe] = &**top["programs"][0]["chains"].as_array().unwrap() else {
        panic!("{top:#}");
    };
    assert_eq!(
        (&pipe["name"], &pipe["limit_ns"]),
        (&"pipe".into(), &5_000_000.into())
    );
    let count = |name: &str| pipe[name].as_u64().unwrap();
    assert!(
        count("begun") >= count("ended") && count("ended") > 0,
        "{pipe:#}"
    );
    let buckets = pipe["histogram"].as_array().unwrap().iter();
    let sum: u64 = buckets.map(|b| b["count"].as_u64().unwrap()).sum();
    // A kill may come between two counts.
    assert!(
        count("ended") - sum <= 1 && pipe["latency_ns"]["count"] == sum,
        "{pipe:#}"
    );

    // The picture: a bar for each stretch on the CPU, and a curve of each budget.
    let svg = scratch.path("a.svg");
    let svg_path = svg.to_str().unwrap();
    let output = program.command(&["trace", &pid, "--svg", svg_path, "--last", "2s"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let svg = std::fs::read_to_string(&svg).unwrap();
    // One of each is the legend's.
    for part in ["class=\"run\"", "class=\"back\"", "class=\"plain\""] {
        assert!(svg.matches(part).count() > 1, "{part}");
    }
    assert_eq!(
        svg.matches("<path class=\"curve\"").count(),
        1,
        "one has a budget"
    );
    assert!(svg.contains(">hungry</text>"));
    assert!(svg.ends_with("</svg>\n"));

    // The end alone.
    let whole = json(&summary)["span_ns"].as_u64().unwrap();
    let file = program.file();
    let file = file.to_str().unwrap();
    let args = ["trace", file, "--last", "20ms", "--perfetto", trace_path];
    let output = run(&[&args[..], &["--json", summary_path]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let span = json(&summary)["span_ns"].as_u64().unwrap();
    assert!(span <= 20_000_000 && span < whole, "{span} of {whole}");
}

/// A copy that is taken while the program writes is whole, and read as the file is.
#[test]
fn a_dump_is_taken_from_outside_while_the_program_runs() {
    let scratch = Scratch::new("dumped");
    let program = Program::start("dumped");
    program.wait(&scratch.path("top.json"));
    let pid = program.child.id().to_string();
    let [dump, trace, out] = ["a.dump", "a.pftrace", "a.json"].map(|name| scratch.path(name));
    let [dump_path, trace_path, out_path] = [&dump, &trace, &out].map(|p| p.to_str().unwrap());
    let output = program.command(&["trace", &pid, "--dump", dump_path]);
    assert!(output.status.success(), "{}", stderr(&output));
    let args = [
        "trace",
        dump_path,
        "--perfetto",
        trace_path,
        "--json",
        out_path,
    ];
    let output = run(&args);
    assert!(output.status.success(), "{}", stderr(&output));
    let summary = json(&out);
    assert_eq!(summary["alive"], false, "a copy of it does not run");
    let rings = summary["rings"].as_array().unwrap();
    assert!(rings.iter().all(|r| r["torn"] == 0), "{summary:#}");
    check(&std::fs::read(&trace).unwrap());
    let output = run(&["why", dump_path, "--json", out_path]);
    assert!(output.status.success(), "{}", stderr(&output));
    for late in json(&out)["late"].as_array().unwrap() {
        let parts = late["parts"].as_object().unwrap();
        let sum: u64 = parts.values().map(|ns| ns.as_u64().unwrap()).sum();
        assert_eq!(late["response_ns"], sum, "{late:#}");
    }
    let output = program.command(&["trace", &pid]);
    assert_eq!(
        output.status.code(),
        Some(2),
        "neither --perfetto nor --dump"
    );
}

/// Emptied, the recording would be lost, and the program that maps it would get a signal.
#[test]
fn a_recording_is_not_written_over_by_its_own_trace() {
    let scratch = Scratch::new("over");
    let mut program = Program::start("over");
    program.wait(&scratch.path("top.json"));
    let file = program.file();
    let (link, hard) = (scratch.path("link"), program.directory().join("hard"));
    symlink(&file, &link).unwrap();
    std::fs::hard_link(&file, &hard).unwrap();
    let bytes = std::fs::metadata(&file).unwrap().len();
    let path = file.to_str().unwrap();
    for option in ["--dump", "--perfetto", "--svg", "--json"] {
        for out in [&file, &link, &hard] {
            let out = out.to_str().unwrap();
            let mut args = vec!["trace", path, option, out];
            if option == "--json" {
                args.extend(["--perfetto", "/dev/null"]);
            }
            let output = run(&args);
            assert_eq!(output.status.code(), Some(1), "{args:?}");
            let why = stderr(&output);
            assert!(why.contains("is the recording that is read"), "{why}");
            assert_eq!(std::fs::metadata(&file).unwrap().len(), bytes, "{args:?}");
        }
    }
    assert_eq!(program.child.try_wait().unwrap(), None);
    // A dump takes the place of an older one in one step, and nothing stays beside it.
    let dump = scratch.path("a.dump");
    std::fs::write(&dump, b"older").unwrap();
    let old = std::fs::File::open(&dump).unwrap();
    let output = run(&["trace", path, "--dump", dump.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(
        old.metadata().unwrap().len(),
        5,
        "the older file is as it was"
    );
    assert_eq!(std::fs::metadata(&dump).unwrap().len(), bytes);
    let names = std::fs::read_dir(scratch.path("")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(names.into_iter().all(|name| !name.ends_with(".tmp")));
}

/// Files of strangers: links, directories, half of a file, another's bytes.
#[test]
fn foreign_files_are_left_out_and_named() {
    let scratch = Scratch::new("foreign");
    let mut program = Program::start("foreign");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let (file, directory) = (program.file(), program.directory());
    let whole = std::fs::read(&file).unwrap();
    symlink(&file, directory.join("link.live")).unwrap();
    std::fs::create_dir(directory.join("directory.live")).unwrap();
    std::fs::write(directory.join("half.live"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(directory.join("a\u{1b}[2J.live"), b"nothing").unwrap();
    let mut forged = whole.clone();
    forged[96..104].copy_from_slice(b"\x1b[2J\x07bad");
    std::fs::write(directory.join("forged.live"), &forged).unwrap();
    let top = program.top(&scratch.path("top.json"));
    assert_eq!(top["programs"].as_array().unwrap().len(), 1, "{top:#}");
    let warnings = top["warnings"].as_array().unwrap();
    assert_eq!(warnings.len(), 5, "{top:#}");
    let texts = warnings.iter().map(|w| w.as_str().unwrap());
    assert!(texts.into_iter().all(|w| !w.chars().any(char::is_control)));
    let output = program.command(&["top", "--once", "--ended"]);
    assert!(!output.stdout.contains(&0x1b));
    let output = program.command(&["trace", "nobody", "--perfetto", "/dev/null"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("nobody: no recording of such a program"));
    let output = program.command(&["trace", "x", "--perfetto", "/dev/null", "--last", "5"]);
    assert_eq!(output.status.code(), Some(2));
}
