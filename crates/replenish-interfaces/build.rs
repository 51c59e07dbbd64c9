//! Generates the packages whose features are on; tells dependents where the texts are.

use replenish_msg_gen::{Error, Generator};
use std::env;
use std::path::Path;

const PACKAGES: [&str; 24] = [
    "action_msgs",
    "actionlib_msgs",
    "builtin_interfaces",
    "composition_interfaces",
    "diagnostic_msgs",
    "example_interfaces",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "service_msgs",
    "shape_msgs",
    "statistics_msgs",
    "std_msgs",
    "std_srvs",
    "stereo_msgs",
    "test_msgs",
    "tf2_msgs",
    "trajectory_msgs",
    "type_description_interfaces",
    "unique_identifier_msgs",
    "visualization_msgs",
];

/// Types that `replenish-msg` has written by hand, because everything uses them.
const BY_HAND: [(&str, &[&str]); 4] = [
    ("action_msgs", &["GoalInfo", "GoalStatus"]),
    ("builtin_interfaces", &["Time"]),
    (
        "std_msgs",
        &[
            "Bool", "Empty", "Float32", "Float64", "Int8", "Int16", "Int32", "Int64", "UInt8",
            "UInt16", "UInt32", "UInt64",
        ],
    ),
    ("unique_identifier_msgs", &["UUID"]),
];

fn main() -> Result<(), Error> {
    let share = Path::new(&env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default()).join("share");
    println!("cargo::metadata=SHARE={}", share.display());
    let mut generator = Generator::new().owned_feature("alloc");
    for (package, names) in BY_HAND {
        for name in names {
            let (text, path) = (
                format!("{package}/msg/{name}"),
                format!("{package}::{name}"),
            );
            generator = generator.reuse(text, format!("::replenish_msg::{path}"));
        }
    }
    for package in PACKAGES {
        let feature = format!("CARGO_FEATURE_{}", package.to_uppercase());
        let dir = share.join(package);
        generator = match env::var_os(feature) {
            Some(_) => generator.package_dir(dir),
            // Only for the hashes of services and actions: no code names it.
            None => generator.dependency_dir(dir, format!("crate::{package}")),
        };
    }
    generator.generate_for_cargo()
}
