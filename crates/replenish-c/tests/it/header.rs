//! `include/replenish.h` is the one that the source makes.

use cbindgen::{Builder, DocumentationStyle, Language, Style};
use std::path::PathBuf;

const TOP: &str = "\
/* libreplenish: CPU budgets for threads of C and C++ programs. Linux.
 *
 * Made from the Rust source; do not change it here. After a change there:
 *     REPLENISH_WRITE=1 cargo test -p replenish-c --test it
 *
 * Functions answer REPLENISH_OK (0) or a code; replenish_last_error() has the text. They may be
 * called from any thread, but not from a signal handler, and not in a child after fork().
 */";

pub(crate) fn path(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(file)
}

/// The header of the source as it is now.
pub(crate) fn fresh() -> String {
    let mut config = cbindgen::Config {
        language: Language::C,
        header: Some(TOP.into()),
        include_guard: Some("REPLENISH_H".into()),
        no_includes: true,
        sys_includes: vec!["stddef.h".into(), "stdint.h".into()],
        cpp_compat: true,
        usize_is_size_t: true,
        style: Style::Both,
        documentation_style: DocumentationStyle::Doxy,
        line_length: 100,
        ..cbindgen::Config::default()
    };
    for (rust, c) in [
        ("Options", "replenish_options"),
        ("Usage", "replenish_usage"),
    ] {
        config.export.rename.insert(rust.into(), c.into());
    }
    let mut header = Vec::new();
    Builder::new()
        .with_config(config)
        .with_src(path("src/status.rs"))
        .with_src(path("src/layout.rs"))
        .with_src(path("src/api.rs"))
        .generate()
        .unwrap()
        .write(&mut header);
    let header = String::from_utf8(header).unwrap();
    header.replace("# Safety", "Pointers:")
}

/// Compares a kept file with what it must be; with `REPLENISH_WRITE=1` writes it instead.
pub(crate) fn is_kept(file: &str, now: &str) {
    let path = path(file);
    if std::env::var_os("REPLENISH_WRITE").is_some_and(|value| value == "1") {
        std::fs::write(&path, now).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let mut lines = kept.lines().zip(now.lines());
    let first = lines.find(|(kept, now)| kept != now);
    assert!(
        kept == now,
        "{file} is not that of the source: run with REPLENISH_WRITE=1 and look at the change. \
         First difference: {first:?}"
    );
}

#[test]
fn the_header_is_that_of_the_source() {
    is_kept("include/replenish.h", &fresh());
}
