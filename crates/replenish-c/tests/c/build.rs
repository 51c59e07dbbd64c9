//! The tree that `install.sh` makes, and programs that are built with it.

use replenish_testkit::harness::{Trial, peer_trial};
use replenish_testkit::program::Scratch;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The compilers of C and C++.
pub(crate) const COMPILERS: [(&str, &str); 2] = [("gcc", "g++"), ("clang", "clang++")];

const WARNINGS: [&str; 6] = [
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Werror",
];

const SANITIZERS: &str = "-fsanitize=address,undefined";

/// The way in which a program gets the library.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Link {
    Shared,
    Static,
    /// Shared, with both sanitizers.
    Checked,
}

/// An example: its source, from `examples` on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Example(pub(crate) &'static str);

pub(crate) const EXAMPLES: [Example; 4] = [
    Example("c/budget.c"),
    Example("c/rclc_executors.c"),
    Example("cpp/budgets.cpp"),
    Example("cpp/callback_groups.cpp"),
];

pub(crate) fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// The message that `tool` is missing, if it is not there.
pub(crate) fn missing(tool: &str) -> Option<String> {
    let there = Command::new(tool).arg("--version").output();
    let there = there.is_ok_and(|output| output.status.success());
    (!there).then(|| format!("{tool} is missing (.ci/install test)"))
}

fn succeeded(output: &Output, what: &dyn std::fmt::Debug) -> String {
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{what:?}:\n{out}\n{err}");
    assert_eq!(err, "", "{what:?}");
    out.into_owned()
}

/// Runs a command that must succeed without a word on standard error; its output.
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.output().unwrap();
    succeeded(&output, command)
}

/// Does something with each, side by side: compilers work on one CPU.
pub(crate) fn side_by_side<T: Sync, R: Send>(all: &[T], each: impl Fn(&T) -> R + Sync) -> Vec<R> {
    std::thread::scope(|scope| {
        let each = &each;
        let threads: Vec<_> = all
            .iter()
            .map(|one| scope.spawn(move || each(one)))
            .collect();
        threads
            .into_iter()
            .map(|thread| thread.join().unwrap())
            .collect()
    })
}

/// Installs the library that cargo has built for this test.
pub(crate) fn install(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    let built = std::env::current_exe().unwrap();
    run(Command::new(here("install.sh"))
        .env_remove("DESTDIR")
        .arg("--prefix")
        .arg(scratch.path("usr"))
        .arg("--from")
        .arg(built.parent().unwrap()));
    scratch
}

fn pkg_config(tree: &Scratch, words: &[&str]) -> Vec<String> {
    let mut command = Command::new("pkg-config");
    command
        .env("PKG_CONFIG_PATH", tree.path("usr/lib/pkgconfig"))
        .args(words)
        .arg("replenish");
    let words = run(&mut command);
    words.split_whitespace().map(str::to_owned).collect()
}

/// Builds an example; the program.
pub(crate) fn build(
    tree: &Scratch,
    compilers: (&str, &str),
    example: Example,
    link: Link,
) -> PathBuf {
    let source = here("../../examples").join(example.0);
    let is_c = source.extension().is_some_and(|end| end == "c");
    let (compiler, standard) = if is_c {
        (compilers.0, "-std=c11")
    } else {
        (compilers.1, "-std=c++17")
    };
    let name = source.file_stem().unwrap().to_string_lossy().into_owned();
    let program = tree.path(&format!("{name}-{compiler}-{link:?}"));
    let mut command = Command::new(compiler);
    command
        .args([standard, "-O1", "-g", "-pthread"])
        .args(WARNINGS)
        .arg("-I")
        .arg(here("tests/standin"))
        .arg(source)
        .arg("-o")
        .arg(&program);
    if link == Link::Checked {
        command.args([SANITIZERS, "-fno-sanitize-recover=all"]);
    }
    if link == Link::Static {
        command.args(pkg_config(tree, &["--cflags"]));
        command.arg(tree.path("usr/lib/libreplenish.a"));
        let private = pkg_config(tree, &["--libs-only-l", "--static"]);
        command.args(private.iter().filter(|word| *word != "-lreplenish"));
    } else {
        command.args(pkg_config(tree, &["--cflags", "--libs"]));
        let mut path = std::ffi::OsString::from("-Wl,-rpath,");
        path.push(tree.path("usr/lib"));
        command.arg(path);
    }
    run(&mut command);
    program
}

/// Each header alone, by each standard that its users may have.
fn headers(compilers: (&str, &str)) {
    let tree = install(&format!("headers-{}", compilers.0));
    let each = [
        ("replenish.h", "c", vec!["c99", "c11", "c17"]),
        ("replenish.h", "c++", vec!["c++11", "c++17", "c++20"]),
        ("replenish_rclc.h", "c", vec!["c11", "c17"]),
        ("replenish.hpp", "c++", vec!["c++17", "c++20"]),
        ("replenish_rclcpp.hpp", "c++", vec!["c++17", "c++20"]),
    ];
    for (header, language, standards) in each {
        let compiler = if language == "c" {
            compilers.0
        } else {
            compilers.1
        };
        let source = tree.path(if language == "c" {
            "alone.c"
        } else {
            "alone.cpp"
        });
        std::fs::write(
            &source,
            format!("#include <{header}>\nint main(void) {{ return 0; }}\n"),
        )
        .unwrap();
        side_by_side(&standards, |standard| {
            run(Command::new(compiler)
                .arg(format!("-std={standard}"))
                .args(WARNINGS)
                .args(["-fsyntax-only", "-I"])
                .arg(here("tests/standin"))
                .args(pkg_config(&tree, &["--cflags"]))
                .arg(&source));
        });
    }
}

fn examples(compilers: (&str, &str)) {
    let tree = install(&format!("examples-{}", compilers.0));
    side_by_side(&EXAMPLES, |example| {
        let shared = build(&tree, compilers, *example, Link::Shared);
        let dynamic = run(Command::new("readelf").arg("-d").arg(&shared));
        assert!(dynamic.contains("[libreplenish.so.0]"), "{dynamic}");
    });
    let fixed = build(&tree, compilers, Example("cpp/budgets.cpp"), Link::Static);
    let dynamic = run(Command::new("readelf").arg("-d").arg(&fixed));
    assert!(!dynamic.contains("libreplenish"), "{dynamic}");
}

fn package() {
    let tree = install("package");
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(pkg_config(&tree, &["--modversion"]), [version]);
    // The tree may be moved.
    std::fs::rename(tree.path("usr"), tree.path("opt")).unwrap();
    let configured = |wants: &str| {
        let from = std::fs::read_to_string(here("../../examples/cpp/CMakeLists.txt")).unwrap();
        let examples = here("../../examples").canonicalize().unwrap();
        let text = from
            .replace("replenish 0.1 ", &format!("replenish {wants} "))
            .replace("../c/", &format!("{}/c/", examples.display()))
            .replace(
                "budgets budgets.cpp",
                &format!("budgets {}/cpp/budgets.cpp", examples.display()),
            );
        let source = tree.path("source");
        std::fs::create_dir_all(&source).unwrap();
        std::fs::write(source.join("CMakeLists.txt"), text).unwrap();
        let mut command = Command::new("cmake");
        command
            .arg("-S")
            .arg(source)
            .arg("-B")
            .arg(tree.path(&format!("build-{wants}")))
            .arg("-DCMAKE_PREFIX_PATH=".to_owned() + &tree.path("opt").to_string_lossy());
        command.output().unwrap().status.success()
    };
    assert!(configured("0.1"));
    run(Command::new("cmake")
        .arg("--build")
        .arg(tree.path("build-0.1")));
    for program in ["budget", "budgets"] {
        assert!(tree.path("build-0.1").join(program).exists(), "{program}");
    }
    for other in ["0.2", "1.0", "0.0"] {
        assert!(!configured(other), "{other}");
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = Vec::new();
    for compilers in COMPILERS {
        let lacks = || missing("pkg-config").or(missing(compilers.1));
        let name = |what: &str| format!("{what}_{}", compilers.0);
        trials.push(peer_trial(&name("headers_with"), lacks(), move || {
            headers(compilers);
        }));
        trials.push(peer_trial(&name("examples_with"), lacks(), move || {
            examples(compilers);
        }));
    }
    let lacks = missing("cmake")
        .or(missing("pkg-config"))
        .or(missing("c++"));
    trials.push(peer_trial("a_cmake_project", lacks, package));
    trials
}
