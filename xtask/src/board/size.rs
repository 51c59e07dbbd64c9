//! Flash and RAM of the smallest images, without the kernel: of the talker without an agent in one
//! line each, checked against a bound, and of pong over executor and XRCE client: flash by part,
//! from the symbols of `tools/executor-size`; RAM as the image [`memory`] takes it at set-up.

use super::host::{self, TARGET};
use super::{memory, qemu};
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The most that the talker may take: a change that needs more raises it, and says why. The last
/// one: a peer that is started anew under its name is noticed, endpoints beyond the bound are met
/// later, and long best-effort samples of several writers do not displace each other.
const TALKER_FLASH: u64 = 59_500;
const TALKER_RAM: u64 = 26_000;

/// Builds, measures, prints, writes.
pub(crate) fn run(path: Option<&Path>) -> Outcome {
    let folder = build()?;
    let talker = talker(&folder.join("talker-size"))?;
    let image = folder.join("executor-size");
    let symbols = tool("arm-none-eabi-nm", &["-C", "-S"], &image)?;
    let (flash, fixed) = sections(&image)?;
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
    let named: (u64, u64) = parts.values().fold((0, 0), |a, p| (a.0 + p.0, a.1 + p.1));
    let rest = parts.entry(part("")).or_default();
    rest.0 += flash.saturating_sub(named.0);
    rest.1 += fixed.saturating_sub(named.1);
    let memory = memory::measure()?;
    parts.insert("taken at set-up: XRCE client", (0, memory.client));
    parts.insert("taken at set-up: executor", (0, memory.executor));
    let ram = fixed + memory.client + memory.executor;
    println!(
        "{:<38} {:>8} {:>10}",
        "executor, XRCE client, pong", "flash", "RAM"
    );
    for (name, (flash, ram)) in &parts {
        println!("{name:<38} {flash:>8} {ram:>10}");
    }
    println!("{:<38} {flash:>8} {ram:>10}", "in all");
    println!(
        "besides: kernel, stacks of 4 threads ({} bytes)",
        memory.stacks
    );
    let each = [
        ("worker", memory.worker),
        ("subscription", memory.subscription),
        ("publisher", memory.publisher),
        ("budget", memory.budget),
    ];
    for (what, bytes) in each {
        println!("one more {what:<29} {:>8} {bytes:>10}", 0);
    }
    let list: Vec<_> = parts
        .iter()
        .map(|(name, (flash, ram))| json!({"name": name, "flash_bytes": flash, "static_ram_bytes": ram}))
        .collect();
    let each: BTreeMap<_, _> = each.into_iter().collect();
    write(
        path,
        &json!({"image": "pong", "flash_bytes": flash, "static_ram_bytes": ram, "parts": list,
            "each_ram_bytes": each, "stack_bytes_besides": memory.stacks, "talker": talker}),
    )
}

/// Flash and RAM of the talker: what the image has, and what set-up takes on the board.
fn talker(image: &Path) -> Outcome<Value> {
    let (flash, fixed) = sections(image)?;
    let measured = qemu::measure(&qemu::build_without_texts("talker")?, &[])?;
    let number = |name| measured.get(name).and_then(Value::as_u64);
    let (Some(heap), Some(heard)) = (number("heap"), number("heard")) else {
        return Err(format!("the image `talker` said {measured}"));
    };
    let ram = fixed + heap;
    println!("talker without an agent: flash {flash} bytes of {TALKER_FLASH}");
    println!("talker without an agent: RAM {ram} bytes of {TALKER_RAM}; {heard} numbers heard");
    if flash > TALKER_FLASH || ram > TALKER_RAM {
        return Err("the talker without an agent is larger than its bound".into());
    }
    Ok(json!({"flash_bytes": flash, "ram_bytes": ram, "heard": heard}))
}

/// Bytes of flash and of fixed RAM.
fn sections(image: &Path) -> Outcome<(u64, u64)> {
    let sections = tool("arm-none-eabi-size", &["-A"], image)?;
    let section = |names: &[&str]| -> u64 {
        let lines = sections
            .lines()
            .map(|l| l.split_whitespace().collect::<Vec<_>>());
        lines
            .filter(|w| w.first().is_some_and(|n| names.contains(n)))
            .filter_map(|w| w.get(1)?.parse::<u64>().ok())
            .sum()
    };
    let flash = section(&[".text", ".rodata", ".ARM.exidx", ".data"]);
    Ok((flash, section(&[".data", ".bss"])))
}

/// Links the images without a kernel, with the flags of the program's own `.cargo/config.toml`; the
/// folder of their ELF files.
fn build() -> Outcome<PathBuf> {
    host::check()?;
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tools/executor-size");
    let target = match std::env::var_os("CARGO_TARGET_DIR") {
        Some(dir) => std::path::absolute(PathBuf::from(dir).join("size")),
        None => std::path::absolute(program.join("../../target/size")),
    }
    .map_err(|e| e.to_string())?;
    let status = Command::new("cargo")
        .args(["build", "--quiet", "--profile", "size", "--target", TARGET])
        .current_dir(&program)
        .env("CARGO_TARGET_DIR", &target)
        .env("CARGO_INCREMENTAL", "0") // in pieces it is larger
        .env_remove("RUSTFLAGS")
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if status.success() {
        Ok(target.join(TARGET).join("size"))
    } else {
        Err("tools/executor-size was not built".into())
    }
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

/// The part that a symbol belongs to, by its name.
fn part(name: &str) -> &'static str {
    let has = |what: &str| name.contains(what);
    // The crate that a symbol begins with, or that implements something: the first one named.
    let first = |what: &str| name.find(what).unwrap_or(usize::MAX);
    let ours = [
        ("replenish_xrce::", "XRCE client"),
        ("replenish::middleware::xrce", "adapter to XRCE"),
        ("replenish::", "executor"),
        ("replenish_os::", "replenish-os: threads, locks, enforcer"),
        ("sporadic::", "sporadic: budget servers"),
        ("replenish_msg::", "messages"),
        ("executor_size::", "pong"),
    ];
    let own = ours.iter().min_by_key(|(prefix, _)| first(prefix));
    if let Some((_, part)) = own.filter(|(prefix, _)| has(prefix)) {
        part
    } else if name == "entry" || has("FnOnce::call_once") {
        "bodies of threads (inlined)"
    } else if has("core::")
        || has("alloc::")
        || has("compiler_builtins")
        || name.starts_with("__")
        || name.starts_with("mem")
    {
        "Rust's core and alloc"
    } else {
        "without a name (constants, padding)"
    }
}
