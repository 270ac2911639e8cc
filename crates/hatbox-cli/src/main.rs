//! The command line of Hatbox.

fn main() {}
