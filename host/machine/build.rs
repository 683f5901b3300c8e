//! Finds the robot files that are built in: two folders up in the repository, inside the folder in
//! a package.
//!
//! In the repository `host/machine/robots` is a symbolic link, for `cargo package`; a checkout
//! without symbolic links builds as well.

fn main() {
    let up = std::path::Path::new("../../robots/l2.toml").exists();
    let folder = if up { "/../../robots" } else { "/robots" };
    println!("cargo:rustc-env=GANTRY_TAU_ROBOTS={folder}");
    println!("cargo:rerun-if-changed=build.rs");
}
