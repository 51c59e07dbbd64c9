//! For any input: no panic, an error or an answer, and names that stay names.

use crate::parse_with;
use proptest::prelude::*;
use replenish_args::{Environment, Kind, RosArgs};

fn token() -> impl Strategy<Value = String> {
    "[a-z_][a-z0-9_]{0,4}"
}

fn full() -> impl Strategy<Value = String> {
    prop::collection::vec(token(), 1..5).prop_map(|parts| format!("/{}", parts.join("/")))
}

fn is_name(name: &str) -> bool {
    let plain = |t: &str| {
        t.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && t.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    name.strip_prefix('/')
        .is_some_and(|rest| rest.split('/').all(plain))
}

proptest! {
    #[test]
    fn any_text_is_an_argument_or_an_error(
        args in prop::collection::vec(
            prop_oneof![
                Just("--ros-args".to_owned()), Just("-r".to_owned()), Just("-p".to_owned()),
                Just("--".to_owned()), Just("--params-file".to_owned()), ".{0,12}",
                "[a~/:=*{}\\\\1_.]{0,12}",
            ],
            0..8,
        ),
        yaml in ".{0,40}",
    ) {
        let read = |_: &str| Ok(yaml.clone());
        let parsed = RosArgs::parse_with(args.clone(), &Environment::default(), &read);
        match parsed {
            Ok(parsed) => {
                if let Ok(name) = parsed.name(Kind::Topic, "/a/b", "/ns/n") {
                    prop_assert!(is_name(&name), "{name}");
                }
                prop_assert!(is_name(&parsed.node("/ns/n", false).unwrap()));
            }
            Err(e) => prop_assert!(!e.problem.is_empty() && !e.place.is_empty()),
        }
    }

    #[test]
    fn any_text_is_a_file_or_an_error(yaml in "([ \n:\\[\\]{}a-z0-9.*/&!\"'-]|ros__parameters|/\\*\\*){0,60}") {
        let parsed = parse_with("--ros-args --params-file f.yaml", &yaml);
        if let Err(e) = parsed {
            prop_assert!(e.place.starts_with("f.yaml:"), "{e}");
        }
    }

    #[test]
    fn without_rules_names_stay(name in full(), node in full()) {
        let args = RosArgs::default();
        prop_assert_eq!(args.name(Kind::Topic, &name, &node).unwrap(), name.clone());
        prop_assert_eq!(args.node(&node, false).unwrap(), node);
    }

    #[test]
    fn a_rule_moves_its_name_and_no_other(from in full(), to in full(), other in full(), node in full()) {
        let args = parse_with(&format!("--ros-args -r {from}:={to}"), "").unwrap();
        prop_assert_eq!(args.name(Kind::Service, &from, &node).unwrap(), to);
        if other != from {
            prop_assert_eq!(args.name(Kind::Service, &other, &node).unwrap(), other.clone());
        }
    }

    /// `/**` stands for the whole name, wherever it is cut.
    #[test]
    fn wildcards_give_back_what_they_took(name in full(), at in 0usize..4, node in full()) {
        let parts: Vec<&str> = name.split('/').skip(1).collect();
        let at = at.min(parts.len() - 1);
        let mut pattern = parts.clone();
        pattern[at] = "*";
        let line = format!("--ros-args -r /{}:=/x/\\1", pattern.join("/"));
        let args = parse_with(&line, "").unwrap();
        prop_assert_eq!(args.name(Kind::Topic, &name, &node).unwrap(), format!("/x/{}", parts[at]));
        let args = parse_with("--ros-args -r /**:=/x/\\1", "").unwrap();
        prop_assert_eq!(args.name(Kind::Topic, &name, &node).unwrap(), format!("/x{name}"));
    }

    #[test]
    fn numbers_come_back(int in any::<i64>(), double in any::<f64>()) {
        let args = parse_with(&format!("--ros-args -p i:={int} -p d:={double:?}"), "").unwrap();
        let given = |name| args.parameter("/n", name).unwrap().value.clone();
        prop_assert_eq!(given("i"), replenish_args::Value::Integer(int));
        if double.is_finite() {
            prop_assert_eq!(given("d"), replenish_args::Value::Double(double));
        }
    }
}
