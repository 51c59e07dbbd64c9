//! The owner of each argument, and the sentences for arguments without one.

use crate::{parse, parse_with, refused};
use replenish_args::{Environment, LogLevel, RosArgs};

#[test]
fn the_programs_own_arguments_stay() {
    let args = parse("--fast --ros-args -r a:=b -- -p mine --ros-args -p x:=1 -- last");
    assert_eq!(args.rest(), ["program", "--fast", "-p", "mine", "last"]);
    assert!(args.parameter("/n", "x").is_some());
    assert_eq!(parse("").rest(), ["program"]);
}

#[test]
fn logging_and_enclave_are_kept() {
    let args = parse(
        "--ros-args --log-level warn --log-level robot.arm:=DEBUG --disable-stdout-logs \
         --disable-rosout-logs --disable-external-lib-logs --enable-rosout-logs \
         --log-config-file l.conf --log-file-name run -e /robot/arm",
    );
    let log = args.log();
    assert_eq!(log.level_of("other"), Some(LogLevel::Warn));
    assert_eq!(log.level_of("robot.arm"), Some(LogLevel::Debug));
    assert_eq!(log.level_of("robot.arm.joint"), Some(LogLevel::Debug));
    assert_eq!(log.level_of("robot.armature"), Some(LogLevel::Warn));
    assert!(!log.stdout && log.rosout && !log.external_lib);
    assert_eq!(log.config_file.as_deref(), Some("l.conf"));
    assert_eq!(log.file_name.as_deref(), Some("run"));
    assert_eq!(args.enclave(), Some("/robot/arm"));
    assert_eq!(parse("").log().level_of("any"), None);
}

#[test]
fn errors_name_the_argument_its_place_and_what_is_allowed() {
    let known = "not known behind --ros-args: -r, -p, --params-file, -e, --log-level, \
                 --log-config-file, --log-file-name, --[en|dis]able-stdout-logs, \
                 --[en|dis]able-rosout-logs and --[en|dis]able-external-lib-logs are; -- ends them";
    for (line, sentence) in [
        (
            "x --ros-args --speed 3",
            &*format!("argument 3, --speed: {known}"),
        ),
        ("--ros-args extra", &*format!("argument 2, extra: {known}")),
        ("--ros-args -r", "argument 2, -r: its value is missing"),
        ("--ros-args -r a", "argument 3, a: a rule is from:=to"),
        (
            "--ros-args -r :=b",
            "argument 3, :=b: there is nothing before :=",
        ),
        (
            "--ros-args -r a:=",
            "argument 3, a:=: there is nothing behind :=",
        ),
        (
            "--ros-args -r __node:=a/b",
            "argument 3, __node:=a/b: \"a/b\" is not a node's name: \
             allowed are letters, digits and _, no digit in front",
        ),
        (
            "--ros-args -r __ns:=robot",
            "argument 3, __ns:=robot: \"robot\" is not a namespace: it must begin with /",
        ),
        (
            "--ros-args -r a-b:=c",
            "argument 3, a-b:=c: \"a-b\" is not a name: \
             only letters, digits, _ and /, and * or ** for whole parts, are allowed",
        ),
        (
            "--ros-args -r a:=b//c",
            "argument 3, a:=b//c: \"b//c\" is not a name: it has two / in a row",
        ),
        (
            "--ros-args -r a:={robot}",
            "argument 3, a:={robot}: \"{robot}\" is not a name: \
             {robot} is not known: {node}, {ns} and {namespace} are",
        ),
        (
            "--ros-args -r /*/a:=/b/\\2",
            "argument 3, /*/a:=/b/\\2: \\2 refers to no wildcard: 1 in what is before :=",
        ),
        (
            "--ros-args -r rosaction://a:=b",
            "argument 3, rosaction://a:=b: rosaction:// is not known: \
             rostopic:// and rosservice:// are",
        ),
        (
            "--ros-args -p speed",
            "argument 3, speed: a parameter is name:=value",
        ),
        (
            "--ros-args -p speed:=",
            "argument 3, speed:=: there is no value behind :=",
        ),
        (
            "--ros-args -p a:=[1,x]",
            "argument 3, a:=[1,x]: an array has one type: string in integer array",
        ),
        (
            "--ros-args -p a:={b:1}",
            "argument 3, a:={b:1}: a value is expected here, not a mapping",
        ),
        (
            "--ros-args -p a:b:c:=1",
            "argument 3, a:b:c:=1: \"b:c\" is not a parameter's name: \
             allowed are letters, digits, _, - and / in parts with dots between",
        ),
        (
            "--ros-args --log-level loud",
            "argument 3, loud: allowed is debug, info, warn, error or fatal, also as logger:=level",
        ),
        (
            "--ros-args -e robot",
            "argument 3, robot: not an enclave: it must begin with /",
        ),
        (
            "--ros-args --params-file missing.yaml",
            "argument 3, missing.yaml: entity not found",
        ),
    ] {
        assert_eq!(refused(line), sentence, "{line}");
    }
}

#[test]
fn variables_come_after_arguments() {
    let of = |pairs: &'static [(&str, &str)]| {
        Environment::read(move |name| {
            let pair = pairs.iter().find(|(n, _)| *n == name);
            pair.map(|(_, value)| (*value).to_owned())
        })
    };
    let environment = of(&[
        ("ROS_NAMESPACE", "robot"),
        ("ROS_DOMAIN_ID", "42"),
        ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/e"),
        ("RCUTILS_COLORIZED_OUTPUT", "0"),
    ])
    .unwrap();
    assert_eq!(
        (environment.domain, environment.colours),
        (Some(42), Some(false))
    );
    let with = |line: &str| {
        let args = line.split_whitespace().map(String::from);
        RosArgs::parse(args, &environment).unwrap()
    };
    let plain = with("p");
    assert_eq!(plain.enclave(), Some("/e"));
    assert_eq!(plain.node("/n", false).unwrap(), "/robot/n");
    assert_eq!(plain.node("/own/n", true).unwrap(), "/own/n");
    let said = with("p --ros-args -r __ns:=/said -e /f");
    assert_eq!(said.node("/n", false).unwrap(), "/said/n");
    assert_eq!(said.node("/own/n", true).unwrap(), "/said/n");
    assert_eq!(said.enclave(), Some("/f"));

    assert_eq!(of(&[]).unwrap(), Environment::default());
    assert_eq!(of(&[("ROS_DOMAIN_ID", "")]).unwrap().domain, None);
    for (pairs, sentence) in [
        (
            &[("ROS_DOMAIN_ID", "233")][..],
            "ROS_DOMAIN_ID, 233: allowed is 0 to 232",
        ),
        (
            &[("ROS_NAMESPACE", "a b")],
            "ROS_NAMESPACE, a b: only letters, digits, _ and / are allowed",
        ),
        (
            &[("RCUTILS_COLORIZED_OUTPUT", "yes")],
            "RCUTILS_COLORIZED_OUTPUT, yes: allowed is 0 or 1",
        ),
    ] {
        assert_eq!(of(pairs).unwrap_err().to_string(), sentence);
    }
}

#[test]
fn what_is_given_later_wins() {
    let yaml = "/**: {ros__parameters: {a: 1, b: 1}}";
    let args = parse_with("--ros-args -p a:=0 --params-file f.yaml -p b:=2", yaml).unwrap();
    let value = |name| args.parameter("/n", name).unwrap().value.to_string();
    assert_eq!((value("a"), value("b")), ("1".into(), "2".into()));
    assert_eq!(args.parameters("/n").count(), 4);
}
