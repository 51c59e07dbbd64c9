//! Flash and static RAM of an image, by part, from its symbols.

use crate::{Outcome, qemu, write};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Builds, measures, prints, writes.
pub(crate) fn run(path: Option<&Path>) -> Outcome {
    let image = qemu::build("budgets")?;
    let symbols = tool("arm-none-eabi-nm", &["-C", "-S"], &image)?;
    let sections = tool("arm-none-eabi-size", &["-A"], &image)?;
    let section = |names: &[&str]| -> u64 {
        let lines = sections
            .lines()
            .map(|l| l.split_whitespace().collect::<Vec<_>>());
        lines
            .filter(|w| w.first().is_some_and(|n| names.contains(n)))
            .filter_map(|w| w.get(1)?.parse::<u64>().ok())
            .sum()
    };
    let mut parts = BTreeMap::<&str, (u64, u64)>::new();
    for (name, kind, bytes) in symbols.lines().filter_map(symbol) {
        let part = parts.entry(part(name)).or_default();
        match kind {
            't' | 'r' | 'w' => part.0 += bytes,
            'd' => *part = (part.0 + bytes, part.1 + bytes),
            'b' => part.1 += bytes,
            _ => {}
        }
    }
    let flash = section(&[".vectors", ".text", ".rodata", ".ARM.exidx", ".data"]);
    let ram = section(&[".data", ".bss"]);
    let named: (u64, u64) = parts.values().fold((0, 0), |a, p| (a.0 + p.0, a.1 + p.1));
    parts.insert(
        "without a name (constants, padding)",
        (flash.saturating_sub(named.0), ram.saturating_sub(named.1)),
    );
    println!(
        "{:<38} {:>8} {:>10}",
        "image budgets", "flash", "static RAM"
    );
    for (name, (flash, ram)) in &parts {
        println!("{name:<38} {flash:>8} {ram:>10}");
    }
    println!("{:<38} {flash:>8} {ram:>10}", "in all");
    let list: Vec<_> = parts
        .iter()
        .map(|(name, (flash, ram))| json!({"name": name, "flash_bytes": flash, "static_ram_bytes": ram}))
        .collect();
    write(
        path,
        &json!({"image": "budgets", "flash_bytes": flash, "static_ram_bytes": ram, "parts": list}),
    )
}

fn tool(program: &str, arguments: &[&str], image: &Path) -> Outcome<String> {
    let output = Command::new(program).args(arguments).arg(image).output();
    let output = output.map_err(|e| format!("{program}: {e}"))?;
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// `address size kind name`: name, kind in lower case, size.
fn symbol(line: &str) -> Option<(&str, char, u64)> {
    let mut words = line.splitn(4, ' ');
    let (_, bytes, kind, name) = (words.next()?, words.next()?, words.next()?, words.next()?);
    let bytes = u64::from_str_radix(bytes, 16).ok()?;
    Some((name, kind.chars().next()?.to_ascii_lowercase(), bytes))
}

/// Which part a symbol belongs to, by its name.
fn part(name: &str) -> &'static str {
    let has = |what: &str| name.contains(what);
    if name == "budgets::HEAP" {
        "heap (stacks, workers, budgets)"
    } else if has("replenish_os") || name.starts_with("rp_") {
        "replenish-os"
    } else if has("sporadic::") {
        "sporadic"
    } else if has("firmware::")
        || has("budgets::")
        || name == "VECTORS"
        || name == "Reset"
        || name == "image_main"
    {
        "board and image"
    } else if has("core::")
        || has("alloc::")
        || has("compiler_builtins")
        || name.starts_with("__")
        || name.starts_with("mem")
    {
        "Rust's core and alloc"
    } else {
        "FreeRTOS kernel"
    }
}
