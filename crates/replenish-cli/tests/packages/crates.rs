//! Every published crate says on crates.io and docs.rs what it is.

use crate::{repository, succeeds};
use replenish_testkit::harness::{Trial, trial};
use serde_json::Value;
use std::process::Command;

/// Slugs of crates.io that are used here. A word that is none is dropped there in silence.
const CATEGORIES: [&str; 14] = [
    "algorithms",
    "command-line-interface",
    "command-line-utilities",
    "concurrency",
    "cryptography",
    "development-tools::build-utils",
    "development-tools::profiling",
    "embedded",
    "encoding",
    "network-programming",
    "no-std",
    "os",
    "science::robotics",
    "simulation",
];

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("every_published_crate_is_described", described),
        trial("a_robot_with_its_own_messages_has_one_dependency", one),
    ]
}

/// `replenish` brings all that a program needs; the generator of messages runs in its build script.
fn one() {
    let packages = packages();
    let robot = packages.iter().find(|p| p["name"] == "robot-app").unwrap();
    let dependencies = robot["dependencies"].as_array().unwrap().iter();
    let names = dependencies.map(|d| (d["name"].as_str().unwrap(), d["kind"].as_str()));
    let names: Vec<_> = names.collect();
    assert_eq!(
        names,
        [("replenish", None), ("replenish-msg-gen", Some("build"))]
    );
}

fn packages() -> Vec<Value> {
    let metadata = succeeds(
        Command::new(env!("CARGO"))
            .args([
                "metadata",
                "--no-deps",
                "--offline",
                "--format-version",
                "1",
            ])
            .current_dir(repository()),
    );
    let metadata: Value = serde_json::from_str(&metadata).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

fn described() {
    let packages = packages();
    let published = |p: &&Value| {
        let manifest = p["manifest_path"].as_str().unwrap();
        p["publish"].is_null() && manifest.contains("/crates/")
    };
    let published: Vec<&Value> = packages.iter().filter(published).collect();
    assert!(published.len() >= 19, "{}", published.len());
    for package in published {
        let name = package["name"].as_str().unwrap();
        for field in [
            "description",
            "license",
            "repository",
            "readme",
            "rust_version",
        ] {
            assert!(package[field].is_string(), "{name}: {field}");
        }
        let description = package["description"].as_str().unwrap();
        assert!(
            !description.ends_with('.') && description.len() > 20,
            "{name}"
        );
        let documentation = format!("https://docs.rs/{name}");
        assert_eq!(package["documentation"], *documentation, "{name}");
        let words = |field: &str| -> Vec<String> {
            let words = package[field].as_array().unwrap().iter();
            words.map(|w| w.as_str().unwrap().to_owned()).collect()
        };
        let (categories, keywords) = (words("categories"), words("keywords"));
        assert!((1..=5).contains(&categories.len()), "{name}");
        for category in categories {
            assert!(CATEGORIES.contains(&&*category), "{name}: {category}");
        }
        assert!((1..=5).contains(&keywords.len()), "{name}");
        assert!(
            keywords.iter().all(|k| k.len() <= 20),
            "{name}: {keywords:?}"
        );
        // docs.rs builds for five systems otherwise; this is one for Linux.
        let targets = &package["metadata"]["docs"]["rs"]["targets"];
        assert_eq!(targets[0], "x86_64-unknown-linux-gnu", "{name}");
    }
}
