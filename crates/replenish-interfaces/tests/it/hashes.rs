//! The agent's table of type hashes is that of this crate. `REPLENISH_REWRITE=1` writes it anew.

use crate::types;
use replenish_msg::{Message, Service};
use std::collections::BTreeSet;

const TABLE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../replenish-agent/src/dds/type_hashes.txt"
);

/// Calls `$each!(Service)` with the full path of every service.
macro_rules! for_each_service {
    ($each:ident) => {
        types::listed! { $each
            action_msgs::srv { CancelGoal }
            composition_interfaces::srv { ListNodes LoadNode UnloadNode }
            diagnostic_msgs::srv { AddDiagnostics SelfTest }
            example_interfaces::srv { AddTwoInts SetBool Trigger }
            lifecycle_msgs::srv { ChangeState GetAvailableStates GetAvailableTransitions GetState
                }
            nav_msgs::srv { GetMap GetPlan LoadMap SetMap }
            rcl_interfaces::srv { DescribeParameters GetLoggerLevels GetParameterTypes
                GetParameters ListParameters SetLoggerLevels SetParameters
                SetParametersAtomically }
            sensor_msgs::srv { SetCameraInfo }
            std_srvs::srv { Empty SetBool Trigger }
            test_msgs::srv { Arrays BasicTypes Empty }
            tf2_msgs::srv { FrameGraph }
            type_description_interfaces::srv { GetTypeDescription }
            visualization_msgs::srv { GetInteractiveMarkers }
        }
    };
}

#[test]
fn the_agent_knows_the_hash_of_every_message_and_service() {
    let mut lines = BTreeSet::new();
    let mut enter = |name: &str, hash: Option<&str>| {
        lines.insert(format!("{name} {}", hash.unwrap()));
    };
    macro_rules! message {
        ($message:ty) => {
            if <$message>::TYPE_NAME.contains("/msg/") {
                enter(<$message>::TYPE_NAME, <$message>::TYPE_HASH);
            }
        };
    }
    types::for_each_type!(message);
    let mut services = 0;
    macro_rules! service {
        ($service:ty) => {
            services += 1;
            enter(<$service>::TYPE_NAME, <$service>::TYPE_HASH);
        };
    }
    for_each_service!(service);
    let mut requests = 0;
    macro_rules! request {
        ($part:ty) => {
            let name = <$part>::TYPE_NAME;
            requests += usize::from(name.contains("/srv/") && name.ends_with("_Request"));
        };
    }
    types::for_each_type!(request);
    assert_eq!(services, requests, "a service is missing in the list above");
    let table: String = lines.iter().map(|line| format!("{line}\n")).collect();
    if std::env::var_os("REPLENISH_REWRITE").is_some() {
        std::fs::write(TABLE, &table).unwrap();
    }
    assert_eq!(std::fs::read_to_string(TABLE).unwrap(), table);
}
