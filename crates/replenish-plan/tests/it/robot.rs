//! The example files of a mobile robot do what their comments say.

use replenish_plan::{Deployment, plan};
use replenish_sim::{Options, simulate};
use std::path::Path;

fn read(name: &str) -> Deployment {
    let path = format!("../../examples/robot/{name}.toml");
    Deployment::read(Path::new(&path)).unwrap_or_else(|e| panic!("{e}"))
}

/// Per worker: its name, callbacks that ended, and those that were late, in a minute.
fn a_minute(file: &Deployment) -> Vec<(String, u64, u64)> {
    let plan = file.plan().unwrap_or_else(|e| panic!("{e}"));
    let system = file.system(&plan);
    let outcome = simulate(&system, &Options::until(60_000_000_000)).unwrap();
    let threads = system.threads.iter().zip(outcome.threads);
    threads
        .map(|(thread, done)| (thread.name.clone(), done.completed, done.misses))
        .collect()
}

#[test]
fn the_robot_fits() {
    let file = read("fits");
    let plan = file.plan().unwrap();
    assert_eq!(plan.chains.len(), 2);
    for chain in &plan.chains {
        assert!(chain.worst.unwrap() <= chain.deadline.unwrap(), "{chain:?}");
    }
    assert_eq!(
        plan.workers[5].amount,
        Some(200_000_000),
        "the planner gets what it desires"
    );
    for (name, completed, late) in a_minute(&file) {
        assert!(completed > 0 || name == "executor", "{name}");
        assert!(
            late == 0 || name == "planner",
            "{name} was late {late} times"
        );
    }
}

#[test]
fn the_camera_is_one_too_many_for_one_cpu() {
    let file = read("refused");
    let refusal = file.plan().unwrap_err();
    assert_eq!(refusal.worker.as_deref(), Some("camera"), "{refusal}");
    assert!(
        refusal.sentence.contains("on CPU 0") && refusal.sentence.contains("would fit"),
        "{refusal}"
    );
    for fit in &refusal.alternatives {
        assert!(plan(&fit.apply(&file.request())).is_ok(), "{fit:?}");
    }
}

#[test]
fn an_overloaded_neighbour_is_late_alone() {
    let (mut camera, mut others) = (0, 0);
    for (name, completed, late) in a_minute(&read("overloaded")) {
        assert!(completed > 0, "{name}");
        match name.as_str() {
            "camera" => camera += late,
            "planner" => {}
            _ => others += late,
        }
    }
    assert!(
        camera > 20 && others == 0,
        "camera {camera}, others {others}"
    );
}

#[test]
fn a_chain_that_takes_too_long_is_refused() {
    let text = std::fs::read_to_string("../../examples/robot/fits.toml").unwrap();
    let text = text.replace("deadline = \"250 ms\"", "deadline = \"120 ms\"");
    let refusal = Deployment::parse(&text, "t")
        .unwrap()
        .plan()
        .unwrap_err()
        .to_string();
    assert!(
        refusal.starts_with("chain \"scan to position\" does not hold: it could take up to ")
            && refusal.contains("where its deadline allows 120 ms")
            && refusal.contains("would fit"),
        "{refusal}"
    );
}
