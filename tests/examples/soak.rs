//! The long soak:
//! `cargo run --release -p gantry-tau-tests --example soak -- --ticks 1000000 --minutes 10`. First
//! simulated ticks, with three axes and with six, then real time over real sockets. Prints its
//! results as JSON; a property that does not hold ends it with a panic.
#![allow(
    clippy::unwrap_used,
    clippy::arithmetic_side_effects,
    reason = "a soak fails by panicking"
)]

use std::time::Duration;

use clap::Parser;
use gantry_tau_tests::soak::{BUDGET, real_time, simulated_time};
use indicatif::{ProgressBar, ProgressStyle};

/// Clients that come and go over links that do harm, for a long time: nothing jumps, nothing leaks,
/// every end has its reason
#[derive(Debug, Parser)]
struct Arguments {
    /// Simulated ticks, once with three axes and once with six and a budget of misses
    #[arg(long, default_value_t = 1_000_000)]
    ticks: u64,
    /// Minutes of real time
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Shows the progress, every thousandth tick.
fn show(bar: &ProgressBar, done: u64) {
    if done % 1_000 == 0 {
        bar.set_position(done);
    }
}

fn main() {
    let arguments = Arguments::parse();
    let mut seen = serde_json::Map::new();
    if arguments.ticks > 0 {
        let bar = bar(2 * arguments.ticks, "ticks");
        let (ticks, seed) = (arguments.ticks, arguments.seed);
        let three = simulated_time::run::<3>(None, ticks, seed, |tick| show(&bar, tick));
        let six =
            simulated_time::run::<6>(Some(BUDGET), ticks, seed, |tick| show(&bar, ticks + tick));
        bar.finish_and_clear();
        eprintln!("{ticks} ticks, twice: every one kept what it must");
        seen.insert(
            "three_axes".to_owned(),
            serde_json::to_value(three).unwrap(),
        );
        seen.insert(
            "six_axes_with_a_budget".to_owned(),
            serde_json::to_value(six).unwrap(),
        );
    }
    if arguments.minutes > 0.0 {
        let duration = Duration::from_secs_f64(60.0 * arguments.minutes);
        let bar = bar(duration.as_secs(), "s of real time");
        let summary = real_time::run(duration, arguments.seed, |elapsed| {
            bar.set_position(elapsed.as_secs());
        });
        bar.finish_and_clear();
        seen.insert("minutes".to_owned(), serde_json::to_value(summary).unwrap());
    }
    println!("{}", serde_json::to_string_pretty(&seen).unwrap());
}

fn bar(length: u64, unit: &str) -> ProgressBar {
    let style = format!("[{{elapsed}}] {{bar:40}} {{pos}}/{{len}} {unit}");
    ProgressBar::new(length).with_style(ProgressStyle::with_template(&style).unwrap())
}
