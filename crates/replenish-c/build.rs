//! The name by which the dynamic linker finds the shared library, whatever its file is called.
//! Programs that were linked with 0.1 go on with 0.2 only if the interface is still the same.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libreplenish.so.0");
}
