//! The promises of `docs/acknowledged.md` are proven: every row names tests, and each of them
//! exists.

use std::path::Path;

#[test]
fn every_promise_names_tests_that_exist() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let page = std::fs::read_to_string(crates.join("../docs/acknowledged.md")).unwrap();
    let mut problems = Vec::new();
    let mut rows = 0;
    let table = page.lines().filter(|line| line.starts_with("| "));
    for row in table.filter(|row| !row.ends_with("| tests |")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let [pair, failure, promise, tests] = cells[..] else {
            problems.push(format!("not four columns: {row}"));
            continue;
        };
        rows += 1;
        if pair.is_empty() || failure.is_empty() || promise.is_empty() {
            problems.push(format!("an empty cell: {row}"));
        }
        for test in tests.split(", ").map(|test| test.trim_matches('`')) {
            let source = test.split_once("::").and_then(|(place, name)| {
                let (of, module) = place.split_once('/')?;
                let file = crates.join(of).join(format!("tests/it/{module}.rs"));
                let text = std::fs::read_to_string(file).ok()?;
                text.contains(&format!("#[test]\nfn {name}()"))
                    .then_some(())
            });
            if source.is_none() {
                problems.push(format!("{failure}: there is no test {test}"));
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(rows >= 20, "{rows} rows");
}
