//! Promises of every type: whatever the bytes, nothing panics, owned value and view agree, and
//! an error is found at the same place; what was decoded survives a round trip.

use proptest::collection::vec;
use proptest::prelude::*;
use replenish_msg::{CdrReader, Endianness, Message, View, Viewed, decode_with_path, encode};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The list of types is complete: it has as many as the interface files have parts.
#[test]
fn the_list_has_every_type() {
    let mut listed = BTreeSet::new();
    macro_rules! each {
        ($ty:path) => {{
            type T = $ty;
            listed.insert(T::TYPE_NAME.to_owned());
        }};
    }
    crate::types::for_each_type!(each);
    let share = Path::new(env!("CARGO_MANIFEST_DIR")).join("share");
    let mut parts = BTreeSet::new();
    let children = |dir: &Path| -> Vec<_> {
        let entries = fs::read_dir(dir).unwrap();
        entries.map(|e| e.unwrap().path()).collect()
    };
    let directories = |dir: &Path| children(dir).into_iter().filter(|p| p.is_dir());
    for package in directories(&share) {
        for kind in directories(&package) {
            for file in children(&kind) {
                let names: &[&str] = match file.extension().and_then(|e| e.to_str()) {
                    Some("srv") => &["_Request", "_Response"],
                    Some("action") => &["_Goal", "_Result", "_Feedback"],
                    _ => &[""],
                };
                let text = |p: &Path| p.file_stem().unwrap().to_str().unwrap().to_owned();
                let (package, kind, name) = (text(&package), text(&kind), text(&file));
                parts.extend(
                    names
                        .iter()
                        .map(|part| format!("{package}/{kind}/{name}{part}")),
                );
            }
        }
    }
    assert_eq!(listed, parts);
}

fn survives<T: Viewed + PartialEq>(bytes: &[u8], order: Endianness) {
    let reader = CdrReader::with_order(bytes, order);
    let mut owned = T::default();
    let result = decode_with_path(&mut owned, &reader);
    let view = T::View::read(&reader);
    assert_eq!(
        result.err(),
        view.as_ref().err().copied(),
        "{}",
        T::TYPE_NAME
    );
    if let Err(error) = result {
        assert!(!error.path().to_string().is_empty() || T::STRUCTURE.fields.is_empty());
        return;
    }
    let mut buf = vec![0; bytes.len() * 2 + 64];
    let len = encode(&owned, &mut buf).unwrap();
    let mut again = vec![0; buf.len()];
    let again_len = view.unwrap().encode_to(&mut again).unwrap();
    assert_eq!(again[..again_len], buf[..len], "{}", T::TYPE_NAME);
    // The second time the bytes are ours: they come back as they were.
    let mut second = T::default();
    decode_with_path(&mut second, &CdrReader::new(&buf[..len])).unwrap();
    let again_len = encode(&second, &mut again).unwrap();
    assert_eq!(again[..again_len], buf[..len], "{}", T::TYPE_NAME);
}

/// Every part of a default value is an error or, where only the end is missing, found there.
fn prefixes<T: Viewed>() {
    let mut buf = vec![0; 1 << 16];
    let len = encode(&T::default(), &mut buf).unwrap();
    assert!(len <= T::MAX_SIZE, "{}", T::TYPE_NAME);
    for cut in 0..len {
        let reader = CdrReader::new(&buf[..cut]);
        assert!(
            decode_with_path(&mut T::default(), &reader).is_err(),
            "{}",
            T::TYPE_NAME
        );
        assert!(T::View::read(&reader).is_err(), "{}", T::TYPE_NAME);
    }
    let view = T::View::from_payload(&buf[..len]).unwrap();
    let mut again = vec![0; len];
    assert_eq!(view.encode_to(&mut again), Ok(len));
    assert_eq!(again, buf[..len]);
}

#[test]
fn no_prefix_of_a_value_is_a_value() {
    macro_rules! each {
        ($ty:path) => {
            prefixes::<$ty>()
        };
    }
    crate::types::for_each_type!(each);
}

/// Bytes that are often nearly right: small lengths at aligned places, short texts.
fn hostile() -> impl Strategy<Value = Vec<u8>> {
    let word = prop_oneof![
        6 => (0u32..4).prop_map(u32::to_le_bytes),
        2 => (0u32..4).prop_map(u32::to_be_bytes),
        1 => any::<[u8; 4]>(),
        1 => Just([b'a', b'b', b'c', 0]),
    ];
    (vec(word, 0..120), 0usize..4).prop_map(|(words, cut)| {
        let mut bytes = words.concat();
        bytes.truncate(bytes.len().saturating_sub(cut));
        bytes
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn arbitrary_bytes_never_panic(bytes in hostile(), big: bool) {
        let order = if big { Endianness::Big } else { Endianness::Little };
        macro_rules! each {
            ($ty:path) => { survives::<$ty>(&bytes, order) };
        }
        crate::types::for_each_type!(each);
    }
}
