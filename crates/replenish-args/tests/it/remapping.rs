//! Rules, as the ROS 2 design page on static remapping has them.

use crate::parse;
use replenish_args::{Kind, RosArgs};

fn topic(line: &str, full: &str, node: &str) -> String {
    parse(&format!("--ros-args {line}"))
        .name(Kind::Topic, full, node)
        .unwrap()
}

#[test]
fn nodes_and_namespaces() {
    let node = |line: &str, given: &str| {
        parse(&format!("--ros-args {line}"))
            .node(given, false)
            .unwrap()
    };
    assert_eq!(node("-r __node:=b", "/ns/a"), "/ns/b");
    assert_eq!(node("-r __name:=b", "/a"), "/b");
    assert_eq!(node("-r __ns:=/x/y", "/ns/a"), "/x/y/a");
    assert_eq!(node("-r __ns:=/", "/ns/a"), "/a");
    assert_eq!(node("-r a:__node:=b", "/a"), "/b");
    assert_eq!(node("-r c:__node:=b", "/a"), "/a");
    // The first of two rules that fit wins, and the namespace's rule looks at the new name.
    assert_eq!(
        node(
            "-r __node:=b -r __node:=c -r b:__ns:=/x -r a:__ns:=/y",
            "/a"
        ),
        "/x/b"
    );
}

#[test]
fn topics_and_services() {
    let node = "/ns/n";
    for (rule, full, new) in [
        ("-r chat:=news", "/ns/chat", "/ns/news"),
        ("-r chat:=news", "/chat", "/chat"),
        ("-r /chat:=/news", "/chat", "/news"),
        ("-r chat:=/news", "/ns/chat", "/news"),
        ("-r ~/chat:=news", "/ns/n/chat", "/ns/news"),
        ("-r chat:=~/news", "/ns/chat", "/ns/n/news"),
        (
            "-r {node}/chat:={ns}/{node}_news",
            "/ns/n/chat",
            "/ns/n_news",
        ),
        ("-r rostopic://chat:=news", "/ns/chat", "/ns/news"),
        ("-r rosservice://chat:=news", "/ns/chat", "/ns/chat"),
        ("-r n:chat:=news", "/ns/chat", "/ns/news"),
        ("-r m:chat:=news", "/ns/chat", "/ns/chat"),
        ("-r n:rostopic://chat:=news", "/ns/chat", "/ns/news"),
        ("-r chat:=a -r chat:=b", "/ns/chat", "/ns/a"),
        ("-r a:=b -r b:=c", "/ns/a", "/ns/b"),
        ("-r /*/chat:=/all/\\1", "/ns/chat", "/all/ns"),
        ("-r /**/chat:=/all/\\1", "/a/b/chat", "/all/a/b"),
        ("-r /**/chat:=/all/\\1", "/chat", "/all"),
        ("-r /**:=/all/\\1", "/a/b", "/all/a/b"),
        ("-r /*/*:=/\\2/\\1", "/a/b", "/b/a"),
        ("-r /*:=/x", "/a/b", "/a/b"),
    ] {
        assert_eq!(topic(rule, full, node), new, "{rule}");
    }
    let args = parse("--ros-args -r rosservice://add:=/sum -r rostopic://add:=/news");
    let name = |kind| args.name(kind, "/ns/add", node).unwrap();
    assert_eq!(name(Kind::Service), "/sum");
    assert_eq!(name(Kind::Topic), "/news");
    assert_eq!(name(Kind::Action), "/ns/add");
    // An action moves once, its parts with it; one of them may go elsewhere.
    assert_eq!(
        topic("-r /**:=/x/\\1", "/fib/_action/status", node),
        "/fib/_action/status"
    );
}

#[test]
fn names_with_substitutions() {
    let plain = |name| RosArgs::substitute(name, "/ns/n");
    assert_eq!(plain("{node}/scan").unwrap(), "n/scan");
    assert_eq!(plain("{ns}/scan").unwrap(), "/ns/scan");
    assert_eq!(plain("/{namespace}/scan").unwrap(), "/ns/scan");
    assert_eq!(RosArgs::substitute("{ns}/scan", "/n").unwrap(), "/scan");
    assert_eq!(
        plain("{robot}/scan").unwrap_err().to_string(),
        "name, {robot}/scan: {robot} is not known: {node}, {ns} and {namespace} are"
    );
    assert!(plain("{node").is_err());
    assert_eq!(plain("a//b").unwrap(), "a//b", "left to be refused");
}
