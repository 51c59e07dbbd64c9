//! What the NuttX back end alone has to get right. Run on Linux by `tools/nuttx-host/test.sh`;
//! without the shim there is nothing to test.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking"
)]

mod common;

#[cfg(nuttx_host)]
mod host;

fn main() {
    #[cfg(nuttx_host)]
    host::main();
    #[cfg(not(nuttx_host))]
    replenish_testkit::harness::run(Vec::new());
}
