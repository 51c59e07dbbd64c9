//! Tells build scripts of dependents where the interface files of `replenish::interfaces` are, so
//! that `replenish-msg-gen` finds them for a program that depends on `replenish` alone.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if let Some(share) = std::env::var_os("DEP_REPLENISH_INTERFACES_SHARE") {
        println!("cargo::metadata=SHARE={}", share.display());
    }
}
