//! Symbols, prototypes, constants and layouts against the kept list, `tests/abi.txt`.
//!
//! A line that changes or goes breaks programs that were compiled before: then the version's minor
//! number and the soname go up. A line more breaks none.

use crate::header::{fresh, is_kept};
use replenish_c::{Options, Usage};
use std::fmt::Write;
use std::mem::{offset_of, size_of};
use std::process::Command;

/// Functions and constants of the header, one a line, without comments.
fn declarations() -> Vec<String> {
    let (mut text, mut rest) = (String::new(), fresh());
    while let Some(begin) = rest.find("/*") {
        text.push_str(&rest[..begin]);
        let end = rest[begin..].find("*/").unwrap();
        rest = rest[begin + end + 2..].to_owned();
    }
    text.push_str(&rest);
    let constants = text.lines().filter(|l| l.starts_with("#define REPLENISH_"));
    let mut found: Vec<String> = constants
        .filter(|line| line.split(' ').count() > 2)
        .map(str::to_owned)
        .collect();
    let text = text.replace("extern \"C\" {", "");
    let plain: String = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .collect::<Vec<_>>()
        .join(" ");
    let functions = plain.split(';').filter(|part| part.contains('('));
    found.extend(functions.map(|part| {
        let words: Vec<&str> = part.split_whitespace().collect();
        words.join(" ").trim_start_matches("} ").to_owned()
    }));
    found
}

fn layouts() -> String {
    let mut text = String::new();
    macro_rules! layout {
        ($type:ty, $name:literal: $($field:ident)*) => {
            writeln!(text, "sizeof {} {}", $name, size_of::<$type>()).unwrap();
            $(writeln!(text, "offsetof {}.{} {}", $name, stringify!($field),
                       offset_of!($type, $field)).unwrap();)*
        };
    }
    layout!(Options, "replenish_options": size name amount_ns period_ns deadline_ns cpu priority
        background reserved);
    layout!(Usage, "replenish_usage": size name amount_ns period_ns at_priority_ns background_ns
        exhaustions replenishments worst_response_ns displaced threads cpu priority at_priority
        sees_blocking reserved);
    text
}

#[test]
#[cfg(target_pointer_width = "64")]
fn the_interface_is_the_kept_one() {
    let mut now = String::from("# 64-bit. See tests/it/abi.rs.\n");
    for line in declarations() {
        writeln!(now, "{line}").unwrap();
    }
    now.push_str(&layouts());
    is_kept("tests/abi.txt", &now);
}

/// Programs can link what the header says, and nothing else of ours.
#[test]
fn the_library_has_the_headers_symbols() {
    let library = std::env::current_exe().unwrap();
    let library = library.with_file_name("libreplenish_c.so");
    // A machine that can link this test has `nm`: it comes with the linker.
    let mut nm = Command::new("nm");
    let output = nm
        .args(["-D", "--defined-only"])
        .arg(&library)
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    let mut symbols: Vec<&str> = text
        .lines()
        .filter_map(|l| l.split(' ').next_back())
        .collect();
    symbols.sort_unstable();
    let declarations = declarations();
    let functions = declarations.iter().filter_map(|line| line.split_once('('));
    let mut functions: Vec<&str> = functions
        .filter_map(|(head, _)| head.split([' ', '*']).next_back())
        .collect();
    functions.sort_unstable();
    assert!(functions.len() > 10, "{functions:?}");
    assert_eq!(symbols, functions);
}
