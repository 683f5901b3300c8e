//! The soak, shortened: `cargo run --release -p gantry-tau-tests --example soak` is the long one.

use std::process::Command;
use std::time::Duration;

use gantry_tau::faults::Fault;
use gantry_tau_core::control::message::Cause;
use gantry_tau_tests::soak::{BUDGET, Summary, real_time, simulated_time};

#[test]
fn three_axes_with_every_fault_and_every_cause() {
    let summary = simulated_time::run::<3>(None, 100_000, 1, |_| {});
    everything_has_happened(&summary, &simulated_time::CAUSES);
}

#[test]
fn six_axes_with_a_budget_and_every_cause() {
    let summary = simulated_time::run::<6>(Some(BUDGET), 100_000, 2, |_| {});
    everything_has_happened(&summary, &simulated_time::CAUSES);
    everything_has_happened(&summary, &[Cause::Budget]);
}

/// Every tick is audited where it is made; what is left is that everything has happened.
fn everything_has_happened(summary: &Summary, causes: &[Cause]) {
    for cause in causes {
        assert!(
            summary.ends.contains_key(&format!("{cause:?}")),
            "no {cause:?}: {summary:?}"
        );
    }
    for fault in Fault::ALL {
        assert!(
            summary.faults.contains_key(&fault.to_string()),
            "no {fault}: {summary:?}"
        );
    }
    assert!(
        summary.sessions > 100 && summary.obtained > 50,
        "{summary:?}"
    );
    assert!(summary.refused > 10, "{summary:?}");
    // The limit is reached, and not exceeded.
    assert_eq!(
        summary.largest_external_change_nm,
        summary.external_limit_nm
    );
}

/// In a process of its own: the memory and files that are counted are a process', and tests beside
/// this one have theirs.
#[test]
fn three_seconds_over_real_sockets() {
    if std::env::var_os("GANTRY_TAU_ALONE").is_none() {
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "soak::three_seconds_over_real_sockets"])
            .env("GANTRY_TAU_ALONE", "1")
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        return assert!(
            output.status.success() && text.contains("1 passed"),
            "{text}"
        );
    }
    let minutes = real_time::run(Duration::from_secs(3), 5, |_| {});
    let summary = &minutes.summary;
    assert!(summary.sessions > 0 && summary.ticks > 0, "{minutes:?}");
    assert!(minutes.others > 0, "{minutes:?}");
    assert!(summary.largest_external_change_nm <= summary.external_limit_nm);
}
