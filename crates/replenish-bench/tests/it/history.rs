//! The paper's open question as a command: the contract of its JSON, and the other files.

use crate::common::{Scratch, json, run, stderr, stdout};

#[test]
fn the_44_rows_come_out_with_the_bugs_and_not_without() {
    let scratch = Scratch::new("history");
    let files = ["json", "csv", "svg", "html"].map(|kind| scratch.path(&format!("h.{kind}")));
    let [j, csv, svg, html] = files.each_ref().map(|p| p.to_str().unwrap());
    let args = ["--json", j, "--csv", csv, "--svg", svg, "--html", html];
    let output = run(&[&["experiment", "nuttx-history"][..], &args].concat());
    assert!(output.status.success(), "{}", stderr(&output));

    let result = json(&files[0]);
    let rows = result["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 44);
    let close = |key: &str| {
        let row_is_close = |row: &&serde_json::Value| {
            let times = |key: &str| row[key].as_array().unwrap().clone();
            let (measured, simulated) = (times("measured_ms"), times(key));
            assert_eq!(measured.len(), simulated.len(), "{row}");
            measured.iter().zip(&simulated).all(|(m, s)| {
                let (m, s) = (m.as_u64().unwrap(), s.as_u64().unwrap());
                m.abs_diff(s) <= 10
            })
        };
        rows.iter().filter(row_is_close).count()
    };
    assert!(close("simulated_ms") >= 40, "{result:#}");
    assert!(close("without_bugs_ms") < 40);
    for (n, row) in rows.iter().enumerate() {
        assert_eq!(row["experiment"].as_u64().unwrap(), n as u64 / 11 + 1);
        assert_eq!(
            row["swept_budget_ms"].as_u64().unwrap(),
            10 * (n as u64 % 11)
        );
    }

    let text = |n: usize| std::fs::read_to_string(&files[n]).unwrap();
    assert_eq!(text(1).lines().count(), 45);
    assert!(text(2).trim_end().ends_with("</svg>") && text(2).contains("FIFO"));
    assert!(text(3).contains("<svg") && !text(3).contains("<script"));
    assert!(stdout(&output).contains("of 44 measurements"));
}
