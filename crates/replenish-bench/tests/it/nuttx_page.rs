//! `docs/nuttx-qemu.md` shows what the emulation gives, row by row.
//!
//! `REPLENISH_UPDATE=1 cargo test -p replenish-bench --test it nuttx_page` writes the tables anew.

use replenish_bench::nuttx::emulated::{Row, experiment_1, experiment_2, two_threads};
use std::path::Path;

const FROM: &str = "<!-- from here on written by tests/it/nuttx_page.rs -->";

fn numbers(of: impl IntoIterator<Item = u64>) -> String {
    let texts: Vec<String> = of.into_iter().map(|n| n.to_string()).collect();
    texts.join(" / ")
}

fn table(title: &str, columns: &str, rows: &[Row]) -> String {
    let good = rows.iter().filter(|r| r.worst_difference() <= 1).count();
    let mut text = format!(
        "\n## {title}: {good} of {} rows within 1 burst\n{columns}\n\n\
         | row | measured | simulated | start, ticks | off by |\n|---|---|---|---|---|\n",
        rows.len()
    );
    for row in rows {
        let off = row.worst_difference();
        let mark = if off > 1 { "**" } else { "" };
        text += &format!(
            "| {} | {} | {} | {} | {mark}{off}{mark} |\n",
            row.setup.replace("-e407-qemu", "").replace(',', ", "),
            numbers(row.measured.iter().copied()),
            numbers(row.simulated.iter().copied()),
            numbers(row.skew_ticks.iter().map(|s| u64::from(*s))),
        );
    }
    text
}

#[test]
fn the_page_shows_what_the_emulation_gives() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/nuttx-qemu.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let at = page.find(FROM).unwrap() + FROM.len() + 1;
    let tables = [
        table(
            "Experiment 1",
            "Row: kernel, tick in us, figure, policy of H, budget in ms. Numbers: H / L.",
            &experiment_1(),
        ),
        table(
            "Experiment 2",
            "Row: kernel, tick in us, cycle of L in us, part of it asleep in %. Numbers: H / L.",
            &experiment_2(),
        ),
        table(
            "Two threads",
            "Row: tick in us, budgets of S1 and S2 in ms, phase in us, with L (1) or without. \
             Numbers: S1 / S2 / L.",
            &two_threads(2),
        ),
    ];
    let tables = tables.concat();
    if std::env::var_os("REPLENISH_UPDATE").is_some() {
        std::fs::write(&path, format!("{}{tables}", &page[..at])).unwrap();
        return;
    }
    assert_eq!(page[at..], tables, "REPLENISH_UPDATE=1 writes it anew");
}
