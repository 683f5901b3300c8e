//! The demo with position loops outside the drives: the same limits as inside.

use gantry_tau::demo::{DemoOptions, PaceChoice, run};
use gantry_tau::server::tick_source::TickSource;

use super::*;

#[test]
fn the_demo_ends_within_its_tolerance() {
    for drives in ["command_delay_cycles = 0\nactual_delay_cycles = 0", ""] {
        let report = std::env::temp_dir().join(format!("gantry-tau-velocity-{}.html", std::process::id()));
        let options = DemoOptions {
            robot: robot(drives),
            client: None,
            pace: PaceChoice::Only(TickSource::Lockstep),
            force_max_n: 120.0,
            force_step_n: 60.0,
            step_seconds: 0.2,
            report: report.clone(),
            json: None,
            record: None,
            black_box: None,
        };
        let results = run::<L2, N, L2_MOTORS>(&options);
        std::fs::remove_file(&report).unwrap();
        assert_eq!(results.unwrap().complaints, Vec::<String>::new(), "{drives}");
    }
}
