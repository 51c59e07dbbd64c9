//! An error in a file is reported with its place and with the allowed values; no text panics.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "test code"
)]

use proptest::prelude::*;
use replenish_msg_gen::{Generator, check_text};
use std::fs;
use std::path::{Path, PathBuf};

fn check(file: &str, text: &str) -> Result<(), String> {
    check_text(&Path::new("my_msgs").join(file), text).map_err(|e| e.to_string())
}

/// The error of a message's text, without the file's name.
fn error(text: &str) -> String {
    let error = check("msg/Thing.msg", text).expect_err(text);
    let rest = error.strip_prefix("my_msgs/msg/Thing.msg:");
    rest.unwrap_or_else(|| panic!("{error}")).to_owned()
}

#[test]
fn every_feature_is_taken() {
    let text = "# A comment.\n\n  int32 a\nint32 b 5 # five\nint8 NEG=-128\nuint64 HEX = 0xff\n\
        float64 x 1e3\nfloat32 y -inf\nbool t true\nstring s \"a # \\\"b\\\"\"\nstring u it's\n\
        string<=5[<=3] v ['a', \"b\"]\nwstring w 'ü'\nwstring<=2[2] z\nbyte[] raw [1, 2]\nchar c 65\n\
        Other o\ngeometry_msgs/Pose[] p\ngeometry_msgs/msg/Pose[3] q\nstring TEXT=free text\n\
        wstring WIDE=\"größe\"\n\
        string EMPTY=\"\"\nfloat32[] none []\r\n\tint16 tabbed\t7\n";
    assert_eq!(check("msg/Thing.msg", text), Ok(()));
    assert_eq!(check("srv/Thing.srv", "int32 a\n---\nint32 a\n"), Ok(()));
    assert_eq!(check("srv/Thing.srv", "---"), Ok(()));
    assert_eq!(
        check("action/Thing.action", "---\n# x\n---\nint32 a"),
        Ok(())
    );
}

#[test]
fn errors_have_a_place_and_say_what_is_allowed() {
    let cases = [
        ("int32", "1:6: a name is missing behind the type"),
        (
            "\n  int33 a",
            "2:3: `int33` is no primitive type (bool, byte",
        ),
        (
            "time stamp",
            "1:1: `time` is a type of ROS 1; in ROS 2 it is `builtin_interfaces/Time`",
        ),
        ("duration d", "`builtin_interfaces/Duration`"),
        ("Header h", "in ROS 2 it is `std_msgs/Header`"),
        (
            "int32 Wrong",
            "1:7: `Wrong` is no name of a field: lower-case letters",
        ),
        ("int32 a__b", "`a__b` is no name of a field"),
        ("int32 a_", "`a_` is no name of a field"),
        (
            "int32 small=1",
            "1:7: `small` is no name of a constant: upper-case letters",
        ),
        ("int32 a\nint32 a", "2:7: there is a field `a` already"),
        (
            "int8 a 128",
            "1:8: `128` is no int8: a whole number in -128..=127 (field `a`)",
        ),
        (
            "uint8 A=-1",
            "`-1` is no uint8: a whole number in 0..=255 (constant `A`)",
        ),
        ("uint64 a 0x1ffffffffffffffff", "is no uint64"),
        ("int8 a 1.5", "`1.5` is no int8"),
        ("bool a yes", "`yes` is no bool: true, false, 1 or 0"),
        ("float32 a x", "`x` is no number of type float32"),
        ("float32 a 1e39", "`1e39` is above the largest float32"),
        ("int8 a 1 2", "1:10: `2` behind the value"),
        ("int8 a \"1\"", "a text where a value of type int8 is meant"),
        (
            "int8[2] a [1]",
            "1:11: 1 values where the type has exactly 2",
        ),
        (
            "int8[<=2] a [1, 2, 3]",
            "3 values where the type has at most 2",
        ),
        (
            "int8[] a 1",
            "a default of several values is a list: `[1, 2, 3]`",
        ),
        ("int8[] a [1", "`,` or `]` is missing"),
        ("int8[] a [1] 2", "`2` behind the list"),
        ("string<=2 a \"abc\"", "1:13: 3 bytes, above the bound of 2"),
        ("string a \"abc", "1:10: the closing `\"` is missing"),
        (
            "Other o 1",
            "a field of a message type has no default value",
        ),
        (
            "Other A=1",
            "a constant is of a primitive type, `string` or `wstring`, and no array",
        ),
        (
            "int8[2] A=1",
            "a constant is of a primitive type, `string` or `wstring`, and no array",
        ),
        (
            "int8[0] a",
            "1:6: `0` is not the size of an array: a whole number in 1..=",
        ),
        ("int8[-1] a", "`-1` is not the size of an array"),
        ("int8[<=x] a", "`x` is not the bound of a sequence"),
        (
            "int8[2 a",
            "`]` is missing; allowed are `[]`, `[N]` and `[<=N]`",
        ),
        (
            "int8<=3 a",
            "`int8` has no bound; `string<=N` and `wstring<=N` have",
        ),
        ("string<=0 a", "`0` is not the bound of a string"),
        ("int8[]] a", "1:7: `]` behind a type"),
        ("a/b/c/D x", "`a/b/c/D` is no type; messages are"),
        ("Wrong_pkg/D x", "`Wrong_pkg` is no name of a package"),
        ("pkg/lower x", "`lower` is no name of a message"),
        (
            "int8 a\n---\nint8 b",
            "2:1: a message has no `---`; services and actions have",
        ),
        ("=", "1:1: a type is missing"),
    ];
    for (text, expected) in cases {
        let error = error(text);
        assert!(error.contains(expected), "{text:?}: {error}");
    }
    let missing = check("srv/Thing.srv", "int8 a\n").unwrap_err();
    assert!(
        missing.contains(":2:1: `---` is missing: a .srv file has 2 parts"),
        "{missing}"
    );
    let many = check("action/Thing.action", "---\n---\n---\n").unwrap_err();
    assert!(
        many.contains(":3:1: one `---` too many: a .action file has 3 parts"),
        "{many}"
    );
}

/// A package in a directory of its own.
struct Package(PathBuf);

impl Package {
    fn new(name: &str, files: &[(&str, &str)]) -> Self {
        let base = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        drop(fs::remove_dir_all(&base));
        for (file, text) in files {
            let path = base.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        Self(base)
    }

    fn generate(&self, package: &str) -> Result<String, String> {
        let out = self.0.join("out");
        let generator = Generator::new().package_dir(self.0.join(package));
        generator.generate(&out).map_err(|e| e.to_string())?;
        Ok(fs::read_to_string(out.join("interfaces.rs")).unwrap())
    }
}

#[test]
fn types_that_are_not_there_or_contain_themselves_are_named() {
    let files = [
        ("a/msg/One.msg", "int32 x\nTwo[] two\n"),
        ("a/msg/Two.msg", "One one\n"),
        ("b/msg/Lost.msg", "int8 x\nMissing m\n"),
        ("c/msg/Lost.msg", "std_msgs/Header h\n"),
        ("d/msg/lower.msg", "int8 x\n"),
        ("E/msg/Fine.msg", "int8 x\n"),
        ("f/other/Fine.msg", "int8 x\n"),
        ("good/msg/Fine.msg", "int8 x\n"),
        ("good/srv/Ask.srv", "Fine f\n---\n"),
    ];
    let package = Package::new("unknown", &files);
    let said = |name: &str| package.generate(name).expect_err(name);
    assert!(said("a").contains("a/msg/One contains itself, through field `one`"));
    assert!(said("b").ends_with("Lost.msg:2:1: there is no b/msg/Missing; package b has Lost"));
    assert!(said("c").contains("package std_msgs was not given; `package_dir` or"));
    assert!(said("d").contains("`lower` is no name of an interface"));
    assert!(said("E").contains("`E` is no name of a package"));
    assert!(said("f").contains("no .msg, .srv or .action files"));
    assert!(said("nowhere").contains("no .msg, .srv or .action files"));
    let good = package.generate("good").unwrap();
    assert!(good.contains("include!(\"good/srv/ask.rs\")"));
}

/// The generator, not the compiler, reports names that ROS 2 allows and Rust cannot hold side by
/// side.
#[test]
fn interfaces_that_want_the_same_name_in_rust_are_named() {
    let files = [
        ("a/msg/Map.msg", "string name\n"),
        ("a/msg/MapView.msg", "int8 x\n"),
        ("b/srv/Ask.srv", "---\n"),
        ("b/srv/AskRequest.srv", "---\n"),
        ("c/msg/IMU.msg", "int8 x\n"),
        ("c/msg/Imu.msg", "int8 x\n"),
        ("good/msg/Map.msg", "int8 x\n"),
        ("good/msg/MapView.msg", "int8 x\n"),
        ("good/srv/Map.srv", "string a\n---\n"),
    ];
    let package = Package::new("clashes", &files);
    let said = |name: &str| package.generate(name).expect_err(name);
    let both = "MapView.msg: `a/msg/MapView` and `a/msg/Map` are both `MapView` in Rust";
    assert!(said("a").ends_with(both), "{}", said("a"));
    let both = "`b/srv/AskRequest` and `b/srv/Ask` are both `AskRequest` in Rust";
    assert!(said("b").ends_with(both), "{}", said("b"));
    let both = "`c/msg/Imu` and `c/msg/IMU` are both `c/msg/imu.rs` in Rust";
    assert!(said("c").ends_with(both), "{}", said("c"));
    package.generate("good").unwrap();
}

proptest! {
    #[test]
    fn no_text_panics(text in "[a-zA-Z0-9_ /\\[\\]<>=#\"'\\\\,.\\-\n\tß]{0,120}") {
        for file in ["msg/Thing.msg", "srv/Thing.srv", "action/Thing.action"] {
            drop(check(file, &text));
        }
    }

    #[test]
    fn no_line_like_one_panics(
        ty in "(int8|string|wstring|bool|float32|Other|p/Q)(<=[0-9]{0,3})?(\\[(<=)?[0-9]{0,3}\\]?)?",
        rest in "( |=|\t)[a-zA-Z_]{0,4} ?=? ?[\\[\"']?[ -~]{0,12}[\\]\"']?",
    ) {
        drop(check("msg/Thing.msg", &format!("{ty}{rest}")));
    }
}
