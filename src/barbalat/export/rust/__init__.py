"""The C of an export in a crate for Rust, with a safe wrapper."""
