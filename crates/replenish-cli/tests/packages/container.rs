//! `deploy/*Containerfile`, as far as it can be checked without building them: each instruction is
//! one, each path is made before it is copied, and the packages exist. No image is built here.

use crate::{repository, succeeds};
use replenish_testkit::harness::{Trial, trial};
use std::process::Command;

const INSTRUCTIONS: [&str; 9] = [
    "FROM",
    "ARG",
    "WORKDIR",
    "COPY",
    "RUN",
    "ENV",
    "USER",
    "ENTRYPOINT",
    "CMD",
];

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("the_agents_file_makes_sense", || sensible("Containerfile")),
        trial("the_robots_file_makes_sense", || {
            sensible("robot.Containerfile");
        }),
        trial("a_robot_gets_what_real_time_needs", real_time),
    ]
}

fn file(name: &str) -> String {
    std::fs::read_to_string(repository().join("deploy").join(name)).unwrap()
}

/// Instructions with their arguments; continued lines are one.
fn instructions(text: &str) -> Vec<(String, String)> {
    let text = text.replace("\\\n", " ");
    let lines = text.lines().map(str::trim);
    let lines = lines.filter(|l| !l.is_empty() && !l.starts_with('#'));
    let pair = |l: &str| {
        let (word, rest) = l.split_once(' ').unwrap_or((l, ""));
        (word.to_owned(), rest.trim().to_owned())
    };
    lines.map(pair).collect()
}

fn sensible(name: &str) {
    let text = file(name);
    let all = instructions(&text);
    let built: String = all
        .iter()
        .filter(|(word, _)| word == "RUN")
        .map(|(_, rest)| rest.as_str())
        .collect();
    for (word, rest) in &all {
        assert!(INSTRUCTIONS.contains(&word.as_str()), "{name}: {word}");
        if matches!(word.as_str(), "ENTRYPOINT" | "CMD") {
            let words: Vec<String> = serde_json::from_str(rest).unwrap();
            assert!(!words.is_empty());
        }
        // Copied out of the build: cargo or a command there has made it.
        if let Some(copied) = rest.strip_prefix("--from=build ") {
            let from = copied.split(' ').next().unwrap();
            let made = from
                .strip_prefix("/src/target/release/replenish")
                .map_or_else(
                    || built.contains(from),
                    |_| built.contains("-p replenish-cli"),
                );
            assert!(made, "{name}: nobody makes {from}: {built}");
        }
    }
    let last = all.iter().rfind(|(word, _)| word == "ENTRYPOINT").unwrap();
    let words: Vec<String> = serde_json::from_str(&last.1).unwrap();
    let installed = |(word, rest): &&(String, String)| word == "COPY" && rest.ends_with(&words[0]);
    assert!(all.iter().any(|i| installed(&i)), "{name}: {words:?}");
    // The compiler of the image is not older than the oldest that builds this.
    let image = &all.iter().find(|(word, _)| word == "FROM").unwrap().1;
    let minor = |text: &str| -> u32 {
        let digits: String = text.chars().take_while(char::is_ascii_digit).collect();
        digits.parse().unwrap()
    };
    let oldest = env!("CARGO_PKG_RUST_VERSION").strip_prefix("1.").unwrap();
    let theirs = image.strip_prefix("rust:1.").unwrap();
    assert!(minor(theirs) >= minor(oldest), "{image}");
    // Each package that cargo is asked for is one, with a program of that name.
    let metadata = succeeds(
        Command::new(env!("CARGO"))
            .args([
                "metadata",
                "--no-deps",
                "--offline",
                "--format-version",
                "1",
            ])
            .current_dir(repository()),
    );
    let metadata: serde_json::Value = serde_json::from_str(&metadata).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let default = all
        .iter()
        .find_map(|(w, r)| Some((w == "ARG").then(|| r.split_once('='))??.1));
    let asked = built.split(" -p ").skip(1);
    for package in asked.map(|rest| rest.split(' ').next().unwrap()) {
        let package = match package {
            "${PACKAGE}" => default.unwrap(),
            package => package,
        };
        let found = packages.iter().find(|p| p["name"] == *package);
        let found = found.unwrap_or_else(|| panic!("{name}: no package {package}"));
        let targets = found["targets"].as_array().unwrap();
        assert!(targets.iter().any(|t| t["kind"][0] == "bin"), "{package}");
    }
}

/// The command line of the file and of the page has each right, and no other capability.
fn real_time() {
    let page = std::fs::read_to_string(repository().join("docs/packaging.md")).unwrap();
    for text in [file("robot.Containerfile"), page] {
        for flag in [
            "--cap-drop ALL",
            "--cap-add SYS_NICE",
            "--ulimit rtprio=99",
            "--ulimit memlock=-1",
            "--network host",
            "-v /run/replenish:/run/replenish",
        ] {
            assert!(text.contains(flag), "{flag}");
        }
        let added = text.matches("--cap-add").count();
        let nice = text.matches("--cap-add SYS_NICE").count();
        assert_eq!(nice, added, "another capability");
    }
}
