//! Machines made around a pose, on stable Rust: core finds what they were made of, and what slow solvers find.

use gantry_tau_proofs::known_solution::{Six, Three, six_is_solved, three_is_solved};
use proptest::array::{uniform2, uniform3, uniform6};
use proptest::prelude::*;

fn points<const K: usize>() -> impl Strategy<Value = [[i16; 3]; K]> {
    proptest::array::uniform::<_, K>(uniform3(any::<i16>()))
}

prop_compose! {
    fn three()(
        origins in points(), guideways in points(), joints in points(), tool: [i16; 3],
        positions: [i16; 3], elsewhere: [i16; 3], moved: [i16; 3],
    ) -> Three {
        Three { origins, guideways, joints, tool, positions, elsewhere, moved }
    }
}

prop_compose! {
    fn six()(
        carts in points(), guideways in points(), plate_joints in points(), joints in points(), axes in points(),
        turn_signs in uniform2(any::<bool>()), tool in uniform6(any::<i16>()), positions in uniform6(any::<i16>()),
        off in uniform6(any::<i16>()),
    ) -> Six {
        Six { carts, guideways, plate_joints, joints, axes, turn_signs, tool, positions, off }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn any_machine_with_three_axes_is_solved(three in three()) {
        three_is_solved(&three);
    }

    #[test]
    fn any_machine_with_six_axes_is_solved(six in six()) {
        six_is_solved(&six);
    }
}
