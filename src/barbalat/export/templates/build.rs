// Compiles the exported C with the machine's cc, or with CC, as its README.md says, and archives it for the linker.
use std::{env, path::PathBuf, process::Command};

fn run(command: &mut Command) {
    let done = command.status().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(done.success(), "{command:?} failed");
}

fn main() {
    let out = PathBuf::from(env::var("OUT_DIR").unwrap());
    let compiler = env::var("CC").unwrap_or_else(|_| "cc".into());
    let archive = out.join("lib${name}_c.a");
    let mut made = Command::new(env::var("AR").unwrap_or_else(|_| "ar".into()));
    made.arg("crs").arg(&archive);
    for source in ["${controller}", "plain.c"] {
        let object = out.join(source).with_extension("o");
        run(Command::new(&compiler).args(["-std=c99", "-ffp-contract=off", "-O2", "-fPIC", "-c", source, "-o"]).arg(&object));
        made.arg(object);
        println!("cargo:rerun-if-changed={source}");
    }
    run(&mut made);
    println!("cargo:rustc-link-search=native={}", out.display());
    println!("cargo:rustc-link-lib=static=${name}_c");
    println!("cargo:rustc-link-lib=m");
}
