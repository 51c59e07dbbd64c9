//! Whole sessions under random schedules of faults: what the fuzz target `session` does, with
//! scripts that no fuzzer chose.
//!
//! `REPLENISH_SCRIPTS=100000 REPLENISH_SEED=7` for as many as you like.

use crate::schedule::{Outcome, run};

fn from_env(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |value| value.parse().unwrap())
}

#[test]
fn no_schedule_of_faults_loses_an_acknowledged_sample() {
    let (scripts, seed) = (
        from_env("REPLENISH_SCRIPTS", 60),
        from_env("REPLENISH_SEED", 1),
    );
    let mut all = Outcome::default();
    let only = from_env("REPLENISH_ONLY", u64::MAX);
    for script in (0..scripts).filter(|script| only == u64::MAX || only == *script) {
        let mut random = (seed << 32 | script).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut draw = || {
            random ^= random >> 12;
            random ^= random << 25;
            random ^= random >> 27;
            (random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 56) as u8
        };
        let bytes: Vec<u8> = (0..400).map(|_| draw()).collect();
        if std::env::var_os("REPLENISH_SHOW").is_some() {
            println!("seed {seed}, script {script}: {bytes:?}");
        }
        let outcome = run(&bytes);
        all.written += outcome.written;
        all.acknowledged += outcome.acknowledged;
        all.not_covered += outcome.not_covered;
        all.repeated += outcome.repeated;
        all.kills += outcome.kills;
    }
    println!("{scripts} scripts, seed {seed}: {all:?}");
    assert!(all.acknowledged * 2 > all.written, "{all:?}");
    assert!(all.not_covered * 10 < all.acknowledged, "{all:?}");
    assert!(all.kills > 0 && all.repeated > 0, "{all:?}");
}
