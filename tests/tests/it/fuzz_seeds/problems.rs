//! Machines to solve.

use gantry_tau_proofs::known_solution::{Six, Three};
use gantry_tau_tests::fuzzed::Problem;

use super::Seed;
use super::bytes::{fields, seeds, variants};

fields!(Three: origins, guideways, joints, tool, positions, elsewhere, moved);
fields!(Six: carts, guideways, plate_joints, joints, axes, turn_signs, tool, positions, off);

variants!(Problem, 3: 0 => Three(three); 1 => Six(six); 2 => Anywhere { place, turn, seed, q };);

const L2: Three = Three {
    origins: [[0; 3]; 3],
    guideways: [[0; 3]; 3],
    joints: [[0; 3]; 6],
    tool: [0; 3],
    positions: [0; 3],
    elsewhere: [0; 3],
    moved: [0; 3],
};

const F1: Six = Six {
    carts: [[0; 3]; 3],
    guideways: [[0; 3]; 3],
    plate_joints: [[0; 3]; 6],
    joints: [[0; 3]; 6],
    axes: [[0; 3]; 2],
    turn_signs: [true, false],
    tool: [0; 6],
    positions: [0; 6],
    off: [0; 6],
};

const FAR: i16 = i16::MAX;

fn anywhere(place: [f64; 3], turn: [f64; 3], seed: Option<[f64; 3]>, q: [f64; 6]) -> Problem {
    Problem::Anywhere {
        place,
        turn,
        seed,
        q,
    }
}

pub(crate) fn seeds() -> Vec<Seed> {
    let here = [0.0, 0.5, 0.65];
    seeds! {
        "three_at_home" => Problem::Three(L2);
        "three_skew_guideways" => Problem::Three(Three { guideways: [[4_000, -9_000, 12_000], [-7_000, 20_000, 3_000], [1, 2, -FAR]],
            origins: [[FAR, 0, 0], [0, -FAR, 900], [0, 77, FAR]], tool: [FAR, -9_000, 12_345], ..L2 });
        "three_out_of_reach" => Problem::Three(Three { elsewhere: [0, FAR, FAR], ..L2 });
        "three_links_that_cannot_meet" => Problem::Three(Three { moved: [FAR, -FAR, FAR], ..L2 });
        "three_other_side" => Problem::Three(Three { positions: [-FAR, FAR, -FAR], ..L2 });
        "three_nearly_singular" => Problem::Three(Three { positions: [-19_600, 19_650, -19_700], elsewhere: [100, 0, 0], moved: [10, -10,
            10], ..L2 });
        // Found by fuzzing: both places of the tool lie within one hundredth of a radian on the
        // circle about the first two carts.
        "three_with_places_side_by_side" => Problem::Three(Three { origins: [[-26_214, -26_215, -26_215], [16_313, 0, 0], [0, 20_224,
            26_214]], guideways: [[-26_183, 26_265, 16_281], [-26_214, -26_215, -26_215], [16_313, -26_214, -26_215]], joints:
            [[-26_215, -26_214, -26_215], [-26_215, -26_183, -26_215], [16_329, -26_111, -26_215], [-26_215, -18_023, 63], [0; 3],
            [26_191, -18_074, -26_215]], tool: [-26_266, -26_049, -26_215], positions: [-26_215, -18_023, -26_049], elsewhere:
            [-26_215, -26_215, -25_959], moved: [-26_215, -26_215, -18_023] });
        "six_at_home" => Problem::Six(F1);
        "six_turned" => Problem::Six(Six { tool: [2_000, -9_000, 4_000, 9_000, -7_000, 12_000], positions: [900, -900, 4_000, 12_000,
            -12_000, 5_000], off: [1_000, -1_000, 1_000, 1_000, -1_000, 1_000], ..F1 });
        "six_turning_the_other_way" => Problem::Six(Six { turn_signs: [false, true], off: [300; 6], ..F1 });
        "six_of_odd_shape" => Problem::Six(Six { carts: [[FAR, 0, 900], [0, -FAR, 0], [12_000, 0, FAR]], guideways: [[9_000, 0, 0], [0,
            9_000, 0], [-9_000, 0, 0]], axes: [[9_000, 0, 0], [0, 0, -9_000]], plate_joints: [[700, -9_000, 1_000]; 6], ..F1 });
        "six_seeded_far_away" => Problem::Six(Six { off: [FAR, -FAR, FAR, -FAR, FAR, -FAR], ..F1 });
        // Found by fuzzing: with the seed's plates two thousandths of a radian off, link 21 starts
        // too near to across, and the first attempt at the inverse diverges.
        "six_with_a_link_across_its_guideway" => Problem::Six(Six { carts: [[0; 3], [0; 3], [0, 0, 13_107]], guideways: [[13_107, 13_107,
            16_339], [-30_841; 3], [-30_841; 3]], plate_joints: [[-30_841; 3]; 6], joints: [[-30_841; 3]; 6], axes: [[-30_841; 3],
            [-30_841, -30_841, -26_214]], turn_signs: [true, true], tool: [-31_591, -18_023, 63, 0, 0, 0], positions: [-26_112,
            -26_215, -26_215, -13_927, 319, -26_214], off: [-26_215, -13_671, 16_313, -26_214, -26_215, -28_263] });
        "somewhere_usual" => anywhere(here, [0.0; 3], None, [0.6, -0.6, 0.6, 0.0, 0.0, 0.0]);
        "somewhere_seeded" => anywhere([0.0, 0.0, 0.3], [0.1, 0.0, 0.2], Some([0.1; 3]), [1.5, 1.5, 1.5, 0.1, 0.1, 0.1]);
        "nowhere" => anywhere([f64::NAN; 3], [f64::INFINITY; 3], Some([f64::NAN; 3]), [f64::NAN; 6]);
        "far_away" => anywhere([1e300, -1e12, 1e4], [1e9, 0.0, 0.0], None, [1e18, -1e-300, 1e3, 4.0, -4.0, 3.15]);
    }
}
