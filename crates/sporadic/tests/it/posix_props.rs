//! Random traces of the POSIX server: agreement with the rules applied unit by unit.

use crate::common::checked::CheckedPosix;
use crate::common::simulator::{budget_and_period, config, play, script};
use proptest::prelude::*;

proptest! {
    #![proptest_config(config())]

    #[test]
    fn agrees_with_the_rules(
        (budget, period) in budget_and_period(),
        max_repl in 1..9u16,
        script in (0..4u64).prop_flat_map(script),
    ) {
        play(&mut CheckedPosix::new(budget, period, max_repl), &script);
    }
}
