//! The table of the example, whose functions these are.

#[path = "../../../../sim/examples/encoders.rs"]
#[expect(dead_code, reason = "the example's own `main`")]
mod encoders;

use encoders::{Line, line};

use super::close;

/// One count, and what it asks for: by hand. The torque at rest is that of a model in Python, over
/// the same places; the loops and an encoder without noise have no scale of their own, so it is 64
/// times as large with a 64th of the counts. One place alone gives 0.32 N to 1.04 N with 2^20
/// counts, and 22 N to 67 N with 2^14.
#[test]
fn the_table_of_encoders() {
    for (counts, expected) in [
        (1 << 20, [9.54, 5.5, 0.852]),
        (1 << 17, [76.3, 43.9, 6.82]),
        (1 << 14, [610.0, 352.0, 54.5]),
    ] {
        let Line {
            step_nm,
            step_n,
            rest_n,
            ..
        } = line(counts).unwrap();
        let [expected_nm, expected_n, expected_rest_n] = expected;
        assert!(close(step_nm, expected_nm, 0.002), "{counts}: {step_nm} nm");
        assert!(close(step_n, expected_n, 0.002), "{counts}: {step_n} N");
        assert!(
            close(rest_n, expected_rest_n, 0.2),
            "{counts}: {rest_n} N at rest"
        );
    }
}
