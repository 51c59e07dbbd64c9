//! `examples/ros2_package`: built by `CMake` as colcon does, installed as `ros2 run` and
//! `ros2 launch` look for it, and run as they start it.

use crate::{empty, missing, repository, succeeds};
use replenish_testkit::harness::{Trial, peer_trial};
use replenish_testkit::program::Running;
use replenish_testkit::rt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// The longest time that any step may take on a busy machine.
const SOON: Duration = Duration::from_secs(60);

pub(crate) fn trials() -> Vec<Trial> {
    let missing = missing("cmake", "cmake");
    vec![peer_trial(
        "the_package_is_found_and_runs",
        missing,
        installed,
    )]
}

/// The value of an attribute at its first place behind `tag`.
fn attribute(xml: &str, tag: &str, name: &str) -> String {
    let rest = xml.split_once(&format!("<{tag} ")).unwrap().1;
    let rest = rest.split_once(&format!("{name}=\"")).unwrap().1;
    rest.split('"').next().unwrap().to_owned()
}

fn installed() {
    let source = repository().join("examples/ros2_package");
    let dir = empty("ament");
    let (build, prefix) = (dir.join("build"), dir.join("install"));
    // The build directory of this test: the library is built already.
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    succeeds(
        Command::new("cmake")
            .args(["-DCARGO_PROFILE=dev", "-S"])
            .arg(&source)
            .arg("-B")
            .arg(&build)
            .arg(format!("-DCARGO_TARGET={}", target.display()))
            .arg(format!("-DCMAKE_INSTALL_PREFIX={}", prefix.display())),
    );
    succeeds(Command::new("cmake").arg("--build").arg(&build));
    succeeds(Command::new("cmake").arg("--install").arg(&build));

    // `ros2 pkg prefix`: the marker in the index has the name of package.xml.
    let package = std::fs::read_to_string(source.join("package.xml")).unwrap();
    let name = package.split_once("<name>").unwrap().1;
    let name = name.split_once("</name>").unwrap().0;
    let index = prefix.join("share/ament_index/resource_index/packages");
    assert!(index.join(name).is_file(), "no {name} in the index");
    let share = prefix.join("share").join(name);
    // colcon's `setup.bash` puts the prefix where ROS 2 searches.
    let hook = std::fs::read_to_string(share.join("local_setup.dsv")).unwrap();
    assert_eq!(hook, "prepend-non-duplicate;AMENT_PREFIX_PATH;\n");
    assert!(package.contains("<build_type>ament_cmake</build_type>"));
    assert!(share.join("package.xml").is_file());

    // `ros2 launch`: the launch file starts a program of this package with files that exist.
    let launch = std::fs::read_to_string(share.join("launch/heartbeat_launch.xml")).unwrap();
    assert_eq!(attribute(&launch, "node", "pkg"), name);
    let exec = attribute(&launch, "node", "exec");
    let overlay = launch.split_once("$(find-pkg-share heartbeat)/").unwrap().1;
    let overlay = share.join(overlay.split('"').next().unwrap());
    assert!(overlay.is_file(), "{}", overlay.display());

    // `ros2 run`, with what the launch file passes on.
    let node: PathBuf = prefix.join("lib").join(name).join(exec);
    let overlay = format!("REPLENISH_OVERLAY={}", overlay.display());
    let words = [
        "REPLENISH_AGENT=in-process",
        "REPLENISH_LEDGER=off",
        &overlay,
        node.to_str().unwrap(),
        "--ros-args",
        "-r",
        "__node:=heart",
        "-r",
        "__ns:=/robot",
        "-r",
        "alive:=/heartbeat",
        "-p",
        "period_ms:=20",
    ];
    // Its worker is real-time if it may be: trials of that kind run one at a time.
    let _alone = rt::lock().unwrap();
    let mut heart = Running::start("env", &words);
    heart.expect_line("/robot/heart beats on /heartbeat", SOON);
    std::thread::sleep(Duration::from_millis(300));
    heart.signal("INT");
    heart.expect_line("beat", SOON);
    assert_eq!(heart.end(SOON).code(), Some(0));
    std::fs::remove_dir_all(dir).ok();
}
