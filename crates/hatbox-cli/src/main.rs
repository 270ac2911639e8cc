//! The command line of Hatbox.

mod args;
mod commands;
mod failure;
mod interrupt;
mod memory;
mod options;
mod output;
mod progress;
mod style;
mod summary;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    // 1. What is asked for. Wrong usage ends here, with status 2; so do `--help` and `--version`, with 0.
    let cli = args::Cli::parse();
    // 2. Ctrl-C is a request from here on; a second one is an order.
    interrupt::listen();
    // 3. The work.
    let done = commands::run(&cli);
    // 4. What became of it.
    match done {
        Ok(status) => status,
        Err(failure) => failure::report(failure),
    }
}
