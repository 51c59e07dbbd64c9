//! The claims of `docs/rclc-parity.md` are proven: every row names tests, and each of them exists.

use std::collections::BTreeMap;
use std::path::Path;

/// The source of a module with tests, of whichever test target, or of all modules of a target.
fn source(crates: &Path, krate: &str, module: &str) -> String {
    // Foreign libraries have a workspace of their own.
    let home = if krate == "peers" { ".." } else { "." };
    let tests = crates.join(home).join(krate).join("tests");
    let places = [".", "it", "rt"].map(|target| tests.join(target).join(format!("{module}.rs")));
    let models = format!("{krate}/src/executor/models/{module}.rs");
    let modules = std::fs::read_dir(tests.join(module)).into_iter().flatten();
    let files = places
        .into_iter()
        .chain(modules.map(|file| file.unwrap().path()))
        .chain([crates.join(models)]);
    files
        .filter_map(|file| std::fs::read_to_string(file).ok())
        .collect()
}

#[test]
fn every_row_names_tests_that_exist() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let table = crates.join("../docs/rclc-parity.md");
    let table = std::fs::read_to_string(table).unwrap();
    let mut sources = BTreeMap::new();
    let mut problems = Vec::new();
    let mut rows = 0;
    for row in table.lines().filter(|l| l.starts_with("| ")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        let [what, here, proof] = cells[..] else {
            problems.push(format!("not three columns: {row}"));
            continue;
        };
        if proof.trim() == "tests" {
            continue; // the head of a table
        }
        rows += 1;
        if here.contains("partly") || proof.trim().is_empty() {
            problems.push(format!("{what}: partly, or without test"));
        }
        for test in proof.split(',').map(|t| t.trim().trim_matches('`')) {
            let (place, name) = test.split_once("::").unwrap_or((test, ""));
            let (krate, target) = place.split_once('/').unwrap_or(("replenish", place));
            let text = sources
                .entry((krate, target))
                .or_insert_with(|| source(crates, krate, target));
            let exists = [format!("fn {name}("), format!("\"{name}\"")];
            if name.is_empty() || !exists.iter().any(|form| text.contains(form)) {
                problems.push(format!("{what}: there is no test {test}"));
            }
        }
    }
    // Models are compiled under `--cfg loom` alone, and run by the stage that the table names.
    let stages = crates.join("../xtask/src/ci/stages.rs");
    let stages = std::fs::read_to_string(stages).unwrap();
    let mut stage = stages.lines().filter(|l| l.contains("--lib loom_"));
    let stage = stage.next().unwrap_or_default();
    let models = sources.iter().filter(|((_, m), _)| m.starts_with("loom_"));
    for ((krate, module), text) in models {
        let door = crates.join(krate).join("src/executor/models/mod.rs");
        let declared = std::fs::read_to_string(door).unwrap_or_default();
        let runs = stage.contains(&format!("-p {krate} "));
        if !runs || !declared.contains(&format!("mod {module};")) || !text.contains("loom::model(")
        {
            problems.push(format!("{module}: `cargo xtask ci loom` does not run it"));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(rows >= 70, "{rows} rows");
}
