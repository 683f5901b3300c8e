//! Machines made around a pose, on stable Rust: core finds what they were made of, and what slow
//! solvers find.

use gantry_tau_proofs::known_solution::{Six, Three, six_is_solved, three_is_solved};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn any_machine_with_three_axes_is_solved(
        origins: [[i16; 3]; 3], guideways: [[i16; 3]; 3], joints: [[i16; 3]; 6], tool: [i16; 3], positions: [i16; 3],
        elsewhere: [i16; 3], moved: [i16; 3],
    ) {
        three_is_solved(&Three { origins, guideways, joints, tool, positions, elsewhere, moved });
    }

    #[test]
    fn any_machine_with_six_axes_is_solved(
        carts: [[i16; 3]; 3], guideways: [[i16; 3]; 3], plate_joints: [[i16; 3]; 6], joints: [[i16; 3]; 6],
        axes: [[i16; 3]; 2], turn_signs: [bool; 2], tool: [i16; 6], positions: [i16; 6], off: [i16; 6],
    ) {
        six_is_solved(&Six { carts, guideways, plate_joints, joints, axes, turn_signs, tool, positions, off });
    }
}
