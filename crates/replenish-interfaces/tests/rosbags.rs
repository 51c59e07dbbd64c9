//! Our bytes and hashes against those of an independent codec, rosbags, for every type that it
//! knows: `peers/golden.py` makes random values, this decodes and encodes them, owned and as views,
//! from either byte order. `tests/peers/setup.sh` installs rosbags; without it these trials count
//! as ignored. `REPLENISH_SEED` and `REPLENISH_VALUES` choose other values and more of them.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

#[path = "support/types.rs"]
mod types;

use replenish_msg::{Message, View, Viewed, decode_encapsulated, encode};
use replenish_testkit::harness::{peer_trial, run};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// rosbags has no `wstring`.
const UNKNOWN: [&str; 2] = ["example_interfaces/msg/WString", "test_msgs/msg/WStrings"];

fn main() {
    let python = python();
    let missing = (!python.exists()).then(|| {
        let script = "crates/replenish-interfaces/tests/peers/setup.sh";
        format!("no {}: run {script}", python.display())
    });
    run(vec![peer_trial(
        "bytes_and_hashes_of_every_type_are_those_of_rosbags",
        missing,
        compare,
    )]);
}

fn python() -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let dir = std::env::var_os("CARGO_TARGET_DIR").map_or(target.to_path_buf(), PathBuf::from);
    // A relative one is meant from the workspace's root.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.join(dir).join("peers/rosbags/bin/python")
}

/// A type as rosbags describes it.
struct Golden {
    hash: String,
    /// Values, each in little and in big endian.
    values: Vec<(Vec<u8>, Vec<u8>)>,
}

fn golden() -> BTreeMap<String, Golden> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let setting = |name, default: &str| std::env::var(name).unwrap_or(default.into());
    let output = Command::new(python())
        .arg(here.join("tests/peers/golden.py"))
        .arg(here.join("share"))
        .args([
            setting("REPLENISH_SEED", "1"),
            setting("REPLENISH_VALUES", "8"),
        ])
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "golden.py: {errors}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(line).collect()
}

fn line(line: &str) -> (String, Golden) {
    let mut words = line.split(' ');
    let name = words.next().unwrap().to_owned();
    let hash = words.next().unwrap().to_owned();
    let mut values = Vec::new();
    if hash != "!" {
        let bytes: Vec<_> = words.map(bytes).collect();
        values.extend(
            bytes
                .chunks_exact(2)
                .map(|pair| (pair[0].clone(), pair[1].clone())),
        );
    }
    (name, Golden { hash, values })
}

fn bytes(hex: &str) -> Vec<u8> {
    let digit = |at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(digit).collect()
}

fn compare() {
    let mut golden = golden();
    let mut seen = 0;
    macro_rules! each {
        ($ty:path) => {{
            type T = $ty;
            let expected = golden.remove(T::TYPE_NAME);
            let expected = expected.unwrap_or_else(|| panic!("{} is missing", T::TYPE_NAME));
            hash::<T>(&expected);
            for (little, big) in &expected.values {
                owned::<T>(little, big);
                view::<T>(little, big);
                seen += 1;
            }
        }};
    }
    types::for_each_type!(each);
    assert!(golden.is_empty(), "types we have not: {:?}", golden.keys());
    println!("{seen} values of rosbags, each in both byte orders, owned and as a view");
    assert!(seen >= 270);
}

fn hash<T: Message>(expected: &Golden) {
    let (name, ours) = (T::TYPE_NAME, T::TYPE_HASH.unwrap());
    match expected.hash.as_str() {
        "!" => assert!(UNKNOWN.contains(&name), "rosbags does not know {name}"),
        "-" => {} // a part of a service or action
        theirs => assert_eq!(ours, theirs, "{name}"),
    }
}

fn owned<T: Message>(little: &[u8], big: &[u8]) {
    let mut stale = T::default(); // of both orders into one value: nothing of the old one stays
    for bytes in [big, little, big] {
        let result = decode_encapsulated(&mut stale, bytes);
        result.unwrap_or_else(|e| panic!("{}: {e}", T::TYPE_NAME));
        let mut buf = vec![0xaa; little.len()];
        let len = encode(&stale, &mut buf).unwrap();
        assert_eq!(buf[..len], little[4..], "{} owned", T::TYPE_NAME);
        assert!(len <= T::MAX_SIZE || !T::BOUNDED);
    }
}

fn view<T: Viewed>(little: &[u8], big: &[u8]) {
    for bytes in [little, big] {
        let view = T::View::from_encapsulated(bytes);
        let view = view.unwrap_or_else(|e| panic!("{}: {e}", T::TYPE_NAME));
        let mut buf = vec![0xaa; little.len()];
        let len = view.encode_to(&mut buf).unwrap();
        assert_eq!(buf[..len], little[4..], "{} view", T::TYPE_NAME);
    }
}
