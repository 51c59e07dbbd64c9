//! The commands of each stage.

use super::stage::Stage;
use std::collections::BTreeMap;
use std::process::Command;

/// The microcontroller that everything without an operating system is built for.
const BOARD: &str = "thumbv7em-none-eabihf";

/// Features of `replenish` that a host builds apart: each set must do without those it does not
/// name. The first is checked with every change, the others at night.
const HOST_FEATURES: [&str; 3] = ["std", "std,xrce", "std,plan"];
/// The sets of a board.
const BOARD_FEATURES: [&str; 3] = [
    "xrce,freertos",
    "xrce,freertos,texts,log",
    "xrce,freertos,full",
];
/// The workspaces beside the main one.
const WORKSPACES: [&str; 6] = [
    "firmware",
    "peers",
    "rclrs",
    "fuzz",
    "tools/xrce-size",
    "tools/nuttx-app",
];

/// One command, with the folder and the variables it needs.
pub(super) struct Step {
    words: Vec<String>,
    folder: &'static str,
    variables: BTreeMap<&'static str, String>,
    repeats: bool,
}

impl Step {
    /// A command of words that contain no blanks.
    fn new(line: &str) -> Self {
        Self {
            words: line.split_whitespace().map(str::to_owned).collect(),
            folder: ".",
            variables: BTreeMap::new(),
            repeats: false,
        }
    }

    fn at(mut self, folder: &'static str) -> Self {
        self.folder = folder;
        self
    }

    fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.variables.insert(name, value.into());
        self
    }

    /// Builds in a folder of its own below the target directory.
    fn building_in(self, folder: &str) -> Self {
        let target = super::paths::target().join(folder);
        self.with("CARGO_TARGET_DIR", target.display().to_string())
    }

    /// Lets the command run again if a few tests fail in it.
    fn repeatable(mut self) -> Self {
        self.repeats = true;
        self
    }

    /// Whether it runs again if a few tests fail in it.
    pub(super) fn may_repeat(&self) -> bool {
        self.repeats
    }

    /// The command as a person would type it.
    pub(super) fn line(&self) -> String {
        let mut line = String::new();
        for (name, value) in self
            .variables
            .iter()
            .filter(|(name, _)| **name != "CARGO_TARGET_DIR")
        {
            line.push_str(&format!("{name}={value:?} "));
        }
        line.push_str(&self.words.join(" "));
        if self.folder != "." {
            line.push_str(&format!("   (in {})", self.folder));
        }
        line
    }

    /// The command, ready to be started.
    pub(super) fn command(&self) -> Command {
        let mut command = Command::new(self.words.first().map_or("true", String::as_str));
        command
            .args(self.words.iter().skip(1))
            .current_dir(super::paths::repository().join(self.folder));
        // No part is built twice here: what makes a second build quick costs the first one time.
        command.env("CARGO_INCREMENTAL", "0").envs(&self.variables);
        command
    }
}

/// The commands of a stage, in order.
pub(super) fn steps(stage: Stage) -> Vec<Step> {
    match stage {
        Stage::Lint => lint_main().into_iter().chain(lint_others()).collect(),
        Stage::LintOthers => lint_others(),
        Stage::LintForeign => lint_foreign(),
        Stage::Test => test(),
        Stage::Loom => loom(),
        Stage::Board => board(),
        Stage::BoardExperiments => board_experiments(),
        Stage::Fuzz => vec![Step::new("fuzz/run 30").building_in("fuzz")],
        Stage::Peers => peers(),
        Stage::BuildPeers => vec![other_libraries(" --no-run")],
        Stage::Arch => arch(),
        Stage::Supply => supply(),
        Stage::Package => vec![package()],
        // `.ci/install` holds the lock while it runs.
        Stage::Installed => vec![Step::new("flock .ci/install true")],
    }
}

fn clippy(words: &str) -> Step {
    Step::new(&format!("cargo clippy {words} -- -D warnings"))
}

/// The main workspace; every command builds in its folder.
pub(super) fn lint_main() -> Vec<Step> {
    let mut steps = vec![
        Step::new("cargo fmt --all --check"),
        Step::new("tools/spelling.sh"),
        Step::new("tools/limits.sh"),
        Step::new("cargo xtask circles"),
        clippy("--workspace --all-targets"),
    ];
    // Each crate that must run on a microcontroller, without the features that others ask of it.
    let bare = |words: &str| clippy(&format!("--target {BOARD} --no-default-features {words}"));
    steps.push(bare(
        "-p sporadic -p replenish-msg -p replenish-xrce -p replenish-rtps",
    ));
    let messages = "sensor_msgs,rcl_interfaces,example_interfaces";
    steps.push(bare(&format!(
        "-p replenish-interfaces --features {messages}"
    )));
    for features in BOARD_FEATURES {
        steps.push(bare(&format!(
            "--features {features} -p replenish -p replenish-os"
        )));
    }
    steps.extend(on_host(&HOST_FEATURES[..1]));
    steps.push(Step::new("cargo doc --workspace --no-deps").with("RUSTDOCFLAGS", "-D warnings"));
    steps
}

/// `replenish` with each set of features.
fn on_host(sets: &'static [&str]) -> impl Iterator<Item = Step> {
    let words =
        |features| format!("-p replenish --lib --no-default-features --features {features}");
    sets.iter().map(move |features| clippy(&words(features)))
}

/// The workspaces beside the main one, the pages' links, and images; each builds in a folder of its
/// own.
fn lint_others() -> Vec<Step> {
    let mut steps = Vec::from(WORKSPACES.map(|folder| Step::new("cargo fmt --check").at(folder)));
    steps.push(Step::new("tools/book.sh"));
    steps.push(clippy("--locked --release --bins").at("firmware"));
    let manifest = "--manifest-path tools/xrce-size/Cargo.toml";
    for image in [
        "--profile size -p executor-size".to_string(),
        format!("--release {manifest}"),
    ] {
        steps.push(clippy(&format!("--locked --target {BOARD} {image}")).building_in("size"));
    }
    steps
}

/// Workspaces that stand on other libraries, which take longer to check than ours, and the book;
/// further sets of features, and the application for NuttX, which stage `board` builds.
fn lint_foreign() -> Vec<Step> {
    let peers = clippy("--locked --manifest-path peers/Cargo.toml --all-targets");
    let fuzz = Step::new("fuzz/run lint");
    let mut steps = vec![
        // One folder for two: they share the crates of others.
        peers.building_in("peers"),
        fuzz.building_in("peers"),
        rclrs_of_jazzy(),
        nuttx("cargo clippy --locked", "-- -D warnings"),
        Step::new("tools/book.sh build"),
    ];
    steps.extend(on_host(&HOST_FEATURES[1..]));
    steps
}

/// The application for NuttX, whose target has no prebuilt library.
fn nuttx(command: &str, end: &str) -> Step {
    let target = "--release -Zbuild-std=core,alloc --target thumbv7em-nuttx-eabihf";
    let manifest = "--manifest-path tools/nuttx-app/Cargo.toml";
    let step = Step::new(&format!("{command} {target} {manifest} {end}"));
    step.with("RUSTC_BOOTSTRAP", "1").building_in("")
}

fn test() -> Vec<Step> {
    vec![
        // The README's command.
        Step::new("cargo test --workspace").repeatable(),
        // The XRCE client as it is on a microcontroller, against the same captures and scripts.
        Step::new(SMALL_CLIENT),
    ]
}

/// Tests of the XRCE client without its features.
const SMALL_CLIENT: &str = "cargo test -p replenish-xrce --no-default-features";

/// Foreign implementations. One that is not installed is a failure here.
fn peers() -> Vec<Step> {
    let trials = [
        "-p replenish-rtps --test peers",
        "-p replenish-agent --test dds_peers",
        "-p replenish --test ros2",
        "-p replenish-bench --test machine ros2::",
    ];
    let trials = trials.map(|words| Step::new(&format!("cargo test {words}")).repeatable());
    let kilted = Step::new("rclrs/with-ros kilted cargo test --locked");
    let mut steps = vec![rclrs_of_jazzy(), kilted.repeatable()];
    steps.push(other_libraries("").repeatable());
    steps.extend(trials.map(required));
    steps
}

/// Genuine rclrs: its types against Jazzy.
fn rclrs_of_jazzy() -> Step {
    Step::new("rclrs/with-ros jazzy cargo clippy --locked --all-targets -- -D warnings")
}

/// Libraries that stand in a workspace of their own: the command of their tests.
fn other_libraries(end: &str) -> Step {
    let line = format!("cargo test --locked --manifest-path peers/Cargo.toml{end}");
    Step::new(&line).building_in("peers")
}

/// A foreign program that is missing is a failure.
fn required(step: Step) -> Step {
    step.with("REPLENISH_REQUIRE_PEERS", "1")
}

/// The stages `test` and `peers` in one, but for rclrs, which is a build of its own and runs at
/// night: `cargo test --workspace` has the trials with foreign programs in it, so that they run
/// once. Stage `build-peers` has run.
pub(super) fn tests_with_peers() -> Vec<Step> {
    let mut steps: Vec<_> = test().into_iter().map(required).collect();
    steps.push(other_libraries("").repeatable());
    steps
}

/// The models, with the bound of the environment on preemptions: without one, three.
fn loom() -> Vec<Step> {
    let preemptions = std::env::var("LOOM_MAX_PREEMPTIONS").unwrap_or_else(|_| "3".to_string());
    let models = Step::new(
        "cargo test --profile loom -p replenish-os -p replenish-handoff -p replenish-recorder -p replenish --lib loom_",
    );
    vec![
        models
            .with("RUSTFLAGS", "--cfg loom")
            .with("LOOM_MAX_PREEMPTIONS", preemptions)
            .building_in("loom"),
    ]
}

/// A robot's program and its command, for machines that CI has not. The compiler of C is for
/// `ring`.
const ROBOT: &str = "-p replenish -p replenish-cli -p replenish-c";
/// The same without encryption, which other libraries bring.
const OWN: &str = "-p replenish -p replenish-agent -p replenish-c";
/// Crates whose tests need no thread of another policy, no socket and no clock: an emulated
/// processor runs them.
const PURE: &str = "-p sporadic -p replenish-wire -p replenish-msg -p replenish-recorder";

/// Other architectures and C libraries, and the oldest compiler that the manifest names.
fn arch() -> Vec<Step> {
    let arm = "aarch64-linux-gnu-gcc";
    let check = |target: &str, what: &str| {
        let line = format!("cargo check --quiet --locked --target {target} {what}");
        Step::new(&line).building_in("arch")
    };
    let emulated = "cargo test --locked --target aarch64-unknown-linux-gnu --lib --tests";
    let oldest = format!("cargo +{OLDEST} check --quiet --locked {OWN}");
    vec![
        check("aarch64-unknown-linux-gnu", ROBOT).with("CC_aarch64_unknown_linux_gnu", arm),
        check("aarch64-unknown-linux-musl", OWN),
        check("x86_64-unknown-linux-musl", OWN),
        Step::new(&format!("{emulated} {PURE}"))
            .with("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", arm)
            .with(
                "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER",
                "qemu-aarch64-static -L /usr/aarch64-linux-gnu",
            )
            .building_in("arch"),
        Step::new(&oldest).building_in("arch"),
    ]
}

/// The oldest compiler, as the root manifest has it.
const OLDEST: &str = env!("CARGO_PKG_RUST_VERSION");

/// Licences, bans and sources of dependencies, and whether every published crate packs.
fn supply() -> Vec<Step> {
    vec![Step::new("tools/deny.sh"), package()]
}

fn package() -> Step {
    let published = "--workspace --exclude executor-size";
    let line = format!("cargo package {published} --no-verify --allow-dirty --quiet");
    Step::new(&line).building_in("package")
}

fn board() -> Vec<Step> {
    let mut steps = vec![
        nuttx("cargo build", ""),
        // The back end for NuttX on this machine, over the same C shim.
        Step::new("tools/nuttx-host/test.sh"),
        Step::new("tools/xrce-size/size.sh"),
        // The program that the boards talk to, and all that the tests need the CPUs for.
        Step::new("cargo test --workspace --no-run"),
        Step::new(&format!("{SMALL_CLIENT} --no-run")),
    ];
    steps.extend(on_board(&[
        "check",
        "test",
        "bench",
        "experiment executor",
        "experiment runaway --tasks",
        "demo --seconds 2",
        "round-trip",
        "recorder",
        "size",
    ]));
    steps
}

/// The paper's experiments. Most exchange messages with this machine: the emulator does little else
/// than wait for it, and it has other work in CI.
fn board_experiments() -> Vec<Step> {
    let mut steps = vec![Step::new("cargo build -p replenish-bench")];
    steps.extend(on_board(&[
        "experiment offsets --tasks",
        "experiment budget-sweep --tasks",
        "experiment budget-sweep --seconds 2",
        "experiment work-conserving --seconds 2",
        "experiment odd-budgets --seconds 2",
        "experiment restart --seconds 2",
        "experiment noise",
    ]));
    steps
}

fn on_board(tasks: &[&str]) -> Vec<Step> {
    let program = super::paths::target().join("debug/replenish-bench");
    let program = program.display().to_string();
    let step = |words: &&str| Step::new(&format!("cargo xtask board {words}"));
    let steps = tasks.iter().map(step);
    steps
        .map(|step| step.with("REPLENISH_PROGRAM", program.clone()))
        .collect()
}
