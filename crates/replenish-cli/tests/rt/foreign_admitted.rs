//! Budgets of `run` and `adopt` beside those of others: the ledger, and the deployment file.

use crate::foreign::{BIN, Foreign, SPIN, cpu, json, until};
use crate::foreign_torture::control_groups;
use replenish_plan::ledger::Ledger;
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::program::{Scratch, stderr, stdout};
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn replenish(ledger: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(BIN);
    command.args(args).env("REPLENISH_LEDGER", ledger);
    command
}

fn output(ledger: &Path, args: &[&str]) -> Output {
    replenish(ledger, args).output().unwrap()
}

/// 60 % are taken while a supervisor lives: a second one with 60 % is refused with the name of the
/// first, and let in when the first was killed.
fn a_foreign_budget_is_in_the_ledger_until_its_supervisor_ends() {
    let scratch = Scratch::new("foreign-ledger");
    let (directory, cpu) = (scratch.path("ledger"), cpu().to_string());
    let (one, two) = (Foreign::shell(SPIN), Foreign::shell(SPIN));
    let [first, second] = [&one, &two].map(|program| program.pid().to_string());
    let adopt = |pid: &str| {
        let args = [
            "adopt",
            pid,
            "--budget",
            "60ms/100ms",
            "--cpu",
            &cpu,
            "--seconds",
            "1",
        ];
        output(&directory, &args)
    };
    let args = ["adopt", &first, "--budget", "60ms/100ms", "--cpu", &cpu];
    let mut command = replenish(&directory, &args);
    let mut supervisor = command.stderr(Stdio::null()).spawn().unwrap();
    let ledger = Ledger::open(&directory).unwrap();
    let entries = || ledger.view().unwrap().entries;
    until("no reservation", || entries().len() == 1);
    assert!(entries()[0].program.contains(&first), "{:?}", entries());
    let refused = adopt(&second);
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    for part in ["no budgets for process", "95 % are allowed", &first] {
        assert!(
            stderr(&refused).contains(part),
            "{part}: {}",
            stderr(&refused)
        );
    }
    supervisor.kill().unwrap();
    supervisor.wait().unwrap();
    assert_eq!(entries().len(), 0);
    let admitted = adopt(&second);
    assert!(admitted.status.success(), "{}", stderr(&admitted));
}

/// One file for `plan`, `run` and `adopt`: the planner's priority is the one that threads get.
fn a_deployment_file_gives_budgets_to_a_program() {
    let scratch = Scratch::new("foreign-file");
    let (directory, cpu) = (scratch.path("ledger"), cpu());
    let [file, plan, report] = ["replenish.toml", "plan.json", "run.json"].map(|f| scratch.path(f));
    let text = format!(
        "[[program]]\nname = \"shell\"\nmatch = \"sh -c n=0*\"\ncpu = {cpu}\n\
         [[program.thread]]\nmatch = \"dds.*\"\n\
         guarantee = {{ budget = \"1 ms\", period = \"10 ms\" }}\n\
         [[program.thread]]\nmatch = \"*\"\n\
         guarantee = {{ budget = \"20 ms\", period = \"100 ms\" }}\n"
    );
    std::fs::write(&file, text).unwrap();
    let [f, p, r] = [&file, &plan, &report].map(|path| path.to_str().unwrap());
    let planned = output(&directory, &["plan", f, "--json", p]);
    assert!(planned.status.success(), "{}", stderr(&planned));
    assert!(
        stdout(&planned).contains("shell dds.*"),
        "{}",
        stdout(&planned)
    );
    let plan = json(&plan);
    let priority = &plan["workers"][1]["priority"];
    let run = [
        "run",
        "--deployment",
        f,
        "--seconds",
        "1",
        "--json",
        r,
        "--",
        "sh",
        "-c",
        SPIN,
    ];
    let done = output(&directory, &run);
    assert_eq!(done.status.code(), Some(128 + 15), "{}", stderr(&done));
    let report = json(&report);
    let thread = &report["threads"][0];
    assert_eq!(thread["policy"], format!("FIFO {priority}, then idle"));
    assert_eq!(thread["budget_ns"], 20_000_000, "{report:#}");
    // No program of the file is for this one.
    let other = ["run", "--deployment", f, "--", "true"];
    let refused = output(&directory, &other);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("no [[program]] is for"),
        "{}",
        stderr(&refused)
    );
    // Processes are found by the file alone.
    let program = Foreign::shell(SPIN);
    let found = ["adopt", "--deployment", f, "--seconds", "1", "--json", r];
    let done = output(&directory, &found);
    assert!(done.status.success(), "{}", stderr(&done));
    let report = json(&scratch.path("run.json"));
    let threads = report["threads"].as_array().unwrap();
    let ours = |row: &serde_json::Value| row["pid"] == program.pid().get();
    assert!(threads.iter().any(ours), "{report:#}");
}

/// `suspend = true` of a file's thread is `--background suspend`: without budget it stands still.
fn a_deployment_file_suspends_a_program() {
    control_groups();
    let scratch = Scratch::new("foreign-suspended");
    let [file, report] = ["replenish.toml", "run.json"].map(|name| scratch.path(name));
    let text = format!(
        "[[program]]\nname = \"shell\"\nmatch = \"sh -c n=0*\"\ncpu = {}\n\
         [[program.thread]]\nmatch = \"*\"\npolicy = {{ kind = \"sporadic\", priority = 50, \
         budget = \"20 ms\", period = \"100 ms\", suspend = true }}\n",
        cpu()
    );
    std::fs::write(&file, text).unwrap();
    let [f, r] = [&file, &report].map(|path| path.to_str().unwrap());
    let run = [
        "run",
        "--deployment",
        f,
        "--seconds",
        "2",
        "--json",
        r,
        "--",
        "sh",
        "-c",
        SPIN,
    ];
    let done = output(&scratch.path("ledger"), &run);
    assert_eq!(done.status.code(), Some(128 + 15), "{}", stderr(&done));
    let report = json(&report);
    let thread = &report["threads"][0];
    assert_eq!(thread["policy"], "FIFO 50, then suspend");
    let ns = |name: &str| thread[name].as_u64().unwrap();
    assert!(ns("exhaustions") >= 1, "{report:#}");
    // A budget a period, and one more at the edge; each may end a little late.
    let periods = report["elapsed_ns"].as_u64().unwrap() / ns("period_ns") + 1;
    let late = ns("budget_ns") / 40;
    let most = periods * (ns("budget_ns") + late);
    assert!(ns("high_ns") <= most, "{most}: {report:#}");
    assert!(ns("background_ns") <= ns("budget_ns"), "{report:#}");
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial(
            "a_foreign_budget_is_in_the_ledger_until_its_supervisor_ends",
            a_foreign_budget_is_in_the_ledger_until_its_supervisor_ends,
        ),
        rt_trial(
            "a_deployment_file_gives_budgets_to_a_program",
            a_deployment_file_gives_budgets_to_a_program,
        ),
        rt_trial(
            "a_deployment_file_suspends_a_program",
            a_deployment_file_suspends_a_program,
        ),
    ]
}
