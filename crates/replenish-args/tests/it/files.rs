//! Files of parameters.

use crate::parse_with;
use replenish_args::{RosArgs, Value};

const ROBOT: &str = r#"
# A robot.
/**:
  ros__parameters:
    use_sim_time: true
    gains: {p: 0.5, i: 1e-3}
    names: [left, "right"]
arm:
  ros__parameters:
    limits:
      speed: 2
      list: [1, 0x10, 017, -3]
    flags: [yes, off]
    empty: []
    text: "12"
    tagged: !!str 12
    wide: !!float 3
    nothing_like_a_number: 1.2.3
/robot/*:
  ros__parameters: {speed: 3}
ns:
  deep:
    node:
      ros__parameters: {speed: .inf}
"#;

fn read(yaml: &str) -> RosArgs {
    parse_with("--ros-args --params-file robot.yaml", yaml).unwrap()
}

fn refused(yaml: &str) -> String {
    let line = "--ros-args --params-file robot.yaml";
    parse_with(line, yaml).unwrap_err().to_string()
}

#[test]
fn nodes_get_their_values() {
    let args = read(ROBOT);
    let value = |node, name| args.parameter(node, name).map(|given| given.value.clone());
    let text = |s: &str| Some(Value::String(s.into()));
    assert_eq!(value("/any/node", "use_sim_time"), Some(Value::Bool(true)));
    assert_eq!(value("/arm", "gains.p"), Some(Value::Double(0.5)));
    assert_eq!(value("/arm", "gains.i"), Some(Value::Double(0.001)));
    let names = vec!["left".to_owned(), "right".to_owned()];
    assert_eq!(value("/arm", "names"), Some(Value::Strings(names)));
    assert_eq!(value("/arm", "limits.speed"), Some(Value::Integer(2)));
    let list = vec![1, 16, 15, -3];
    assert_eq!(value("/arm", "limits.list"), Some(Value::Integers(list)));
    assert_eq!(
        value("/arm", "flags"),
        Some(Value::Bools(vec![true, false]))
    );
    assert_eq!(value("/arm", "empty"), Some(Value::Empty));
    assert_eq!(value("/arm", "text"), text("12"));
    assert_eq!(value("/arm", "tagged"), text("12"));
    assert_eq!(value("/arm", "wide"), Some(Value::Double(3.0)));
    assert_eq!(value("/arm", "nothing_like_a_number"), text("1.2.3"));
    assert_eq!(value("/robot/leg", "speed"), Some(Value::Integer(3)));
    assert_eq!(value("/robot", "speed"), None);
    assert_eq!(value("/ns/arm", "text"), None);
    assert_eq!(
        value("/ns/deep/node", "speed"),
        Some(Value::Double(f64::INFINITY))
    );
    assert_eq!(
        args.parameter("/arm", "text").unwrap().place,
        "robot.yaml:15:11"
    );
    assert_eq!(read("# nothing\n"), read(""));
}

#[test]
fn errors_say_where() {
    for (yaml, sentence) in [
        ("- a", "robot.yaml:1:1: the file must be a mapping"),
        (
            "ros__parameters: {a: 1}",
            "robot.yaml:1:1: ros__parameters stands below a node's name, or below /**",
        ),
        (
            "n:\n  a: 1",
            "robot.yaml:2:6: /n/a must be a mapping with ros__parameters in it",
        ),
        (
            "n:\n  ros__parameters: 3",
            "robot.yaml:2:20: ros__parameters must be a mapping",
        ),
        (
            "n:\n  ros__parameters:\n    a:",
            "robot.yaml:3:6: a: there is no value",
        ),
        (
            "n:\n  ros__parameters:\n    a: [1, 2.5]",
            "robot.yaml:3:12: a: an array has one type: double in integer array",
        ),
        (
            "n:\n  ros__parameters:\n    a: [[1]]",
            "robot.yaml:3:9: a: an array holds values alone: no arrays, no mappings",
        ),
        (
            "n-1:\n  ros__parameters: {a: 1}",
            "robot.yaml:1:1: \"/n-1\" is not a node's name: \
             only letters, digits, _ and /, and * or ** for whole parts, are allowed",
        ),
        (
            "n:\n  ros__parameters: {a: &x 1, b: *x}",
            "robot.yaml:2:33: aliases are not supported",
        ),
        (
            "n:\n  ros__parameters: {a: !!int x}",
            "robot.yaml:2:24: a: a string cannot be tagged !!int",
        ),
    ] {
        assert_eq!(refused(yaml), sentence);
    }
    assert!(refused("a: [").starts_with("robot.yaml:"));
    let deep = format!("n: {{ros__parameters: {{a: {}}}}}", "[".repeat(100));
    assert!(refused(&deep).ends_with("nested too deep: 32 levels are allowed"));
}
