//! Everything around the commands: completions, manual pages, `-q` and `-v`, addresses.

use crate::common::{Scratch, run, stderr, stdout};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

fn example(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    path.join(name).to_str().unwrap().to_string()
}

#[test]
fn every_shell_gets_the_commands_and_bash_understands_them() {
    for (shell, mark) in [
        ("bash", "complete -F _replenish"),
        ("zsh", "#compdef replenish"),
        ("fish", "complete -c replenish"),
    ] {
        let output = run(&["completions", shell]);
        assert!(output.status.success(), "{}", stderr(&output));
        let text = stdout(&output);
        for part in [mark, "suggest", "ignore-ledger", "completions"] {
            assert!(text.contains(part), "{shell}: {part}");
        }
    }
    // A word is completed as a user would see it.
    let script = stdout(&run(&["completions", "bash"]))
        + "\nCOMP_WORDS=(replenish sug)\nCOMP_CWORD=1\n_replenish replenish sug replenish\n\
           echo \"${COMPREPLY[@]}\"\n";
    let mut bash = Command::new("bash")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = bash.stdin.take().unwrap();
    input.write_all(script.as_bytes()).unwrap();
    drop(input);
    let completed = bash.wait_with_output().unwrap();
    assert_eq!(stdout(&completed).trim(), "suggest");

    let output = run(&["completions", "tcsh"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("bash"), "{}", stderr(&output));
}

#[test]
fn the_manual_has_a_page_for_each_command() {
    let page = stdout(&run(&["man"]));
    for part in [
        ".TH replenish 1",
        "SYNOPSIS",
        "suggest",
        "Exit codes: 0 done",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    let scratch = Scratch::new("man");
    let dir = scratch.path("man1");
    let output = run(&["man", "--dir", dir.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let page = |name: &str| std::fs::read_to_string(dir.join(name)).unwrap();
    assert!(page("replenish.1").contains("replenish\\-agent(1)"));
    assert!(page("replenish-plan.1").contains("ignore\\-ledger"));
    assert!(!dir.join("replenish-guardian.1").exists());
    let output = run(&["man", "--dir", "/proc/nowhere"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("/proc/nowhere"));
}

#[test]
fn quiet_says_errors_only_and_verbose_says_more() {
    let refused = example("robot/refused.toml");
    let said = |options: &[&str]| {
        stderr(&run(
            &[&["plan", &refused, "--ignore-ledger"], options].concat()
        ))
    };
    let ordinary = said(&[]);
    assert!(ordinary.contains("As if nothing else ran"), "{ordinary}");
    let quiet = said(&["-q"]);
    assert!(
        quiet.starts_with("replenish: ") && quiet.lines().count() == 1,
        "{quiet}"
    );
    let verbose = said(&["--verbose"]);
    assert!(verbose.contains("it took "), "{verbose}");
    assert!(!ordinary.contains("it took "), "{ordinary}");
    let both = run(&["-q", "-v", "plan", &refused]);
    assert_eq!(both.status.code(), Some(2));
}

/// The refusal, the table and the line of the CPU say one figure.
#[test]
fn a_refusal_has_the_figure_of_the_table_and_names_own_workers() {
    let scratch = Scratch::new("figures");
    let path = scratch.path("both.toml");
    let text = "[machine]\ncpus = [0]\n\
        [[worker]]\nname = \"camera\"\nguarantee = { budget = \"12.3456 ms\", period = \"20 ms\" }\n\
        [[worker]]\nname = \"control\"\nguarantee = { budget = \"4 ms\", period = \"10 ms\" }\n";
    std::fs::write(&path, text).unwrap();
    let output = run(&["plan", path.to_str().unwrap(), "--ignore-ledger"]);
    assert_eq!(output.status.code(), Some(1));
    let (told, table) = (stderr(&output), stdout(&output));
    let (before, _) = told.split_once(" would be reserved").unwrap();
    let share = before.rsplit("CPU 0 ").next().unwrap();
    assert!(
        table.contains(&format!("CPU 0: {share} reserved")),
        "{share}: {table}"
    );
    assert!(told.contains("by worker \"camera\""), "{told}");
    assert!(table.contains("12.35 ms"), "{table}");
    assert!(!table.contains("12.346"), "{table}");
}

#[test]
fn an_address_that_cannot_be_used_says_what_can() {
    for (option, address, part) in [
        ("--udp", ":8888", "for a port alone write 0.0.0.0:8888"),
        ("--udp", "localhost", "192.168.7.1:8888"),
        (
            "--tcp",
            "10.0.0.1:99999",
            "with a port or without one (then 8888)",
        ),
    ] {
        let output = run(&["agent", option, address]);
        assert_eq!(output.status.code(), Some(2));
        let text = stderr(&output);
        assert!(text.contains(part) && text.contains(option), "{text}");
    }
}
