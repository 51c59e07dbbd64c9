//! Compiles the FreeRTOS kernel with the configuration and the shim of replenish-os.

use std::env;
use std::path::PathBuf;

fn main() {
    let here = PathBuf::from(env::var("CARGO_MANIFEST_DIR").unwrap());
    // Set by freertos-next, whose package carries the kernel.
    let kernel = PathBuf::from(env::var("DEP_FREERTOS_KERNEL").unwrap());
    let ours = here.join("../crates/replenish-os/freertos");
    let port = kernel.join("portable/GCC/ARM_CM4F");
    let mut build = cc::Build::new();
    build
        .compiler("arm-none-eabi-gcc")
        .archiver("arm-none-eabi-ar")
        .flag("-mcpu=cortex-m4")
        .flag("-mthumb")
        .flag("-mfloat-abi=hard")
        .flag("-mfpu=fpv4-sp-d16")
        .flag("-ffunction-sections")
        .flag("-fdata-sections")
        .opt_level(2)
        .warnings(false)
        .include(here.join("include"))
        .include(&ours)
        .include(kernel.join("include"))
        .include(&port);
    for file in ["tasks.c", "list.c"] {
        build.file(kernel.join(file));
    }
    build.file(port.join("port.c"));
    build.file(ours.join("shim.c"));
    build.compile("freertos");
    for file in ["FreeRTOSConfig.h", "shim.c", "freertos_tasks_c_additions.h"] {
        println!("cargo:rerun-if-changed={}", ours.join(file).display());
    }
    println!("cargo:rerun-if-changed=link.ld");
    println!("cargo:rustc-link-search={}", here.display());
}
