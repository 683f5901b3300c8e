//! Machines like the L2 and the F1 with known solutions: round trip, residual, codes, and slow
//! solvers beside core's (T13). And the presets, at positions of any bits.

use arbitrary::Arbitrary;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_proofs::known_solution::{Six, Three, six_is_solved, three_is_solved};
use gantry_tau_proofs::properties::kinematics::{
    check_is_right, forward_is_inside, inverse_in_assembly_is_inside, inverse_is_inside,
    lengths_are_kept,
};
use gantry_tau_proofs::properties::six_link::{self, answers_are_checked, tracker_is_checked};
use gantry_tau_proofs::robots;

/// A problem of the kinematics.
#[derive(Arbitrary, Clone, Copy, Debug, PartialEq)]
pub enum Problem {
    /// A machine with three axes.
    Three(Three),
    /// A machine with six axes.
    Six(Six),
    /// The usual machines somewhere: a place, a rotation vector, a seed for the plates, and
    /// positions.
    Anywhere {
        /// The tool's place, m.
        place: [f64; 3],
        /// Its rotation vector, rad.
        turn: [f64; 3],
        /// Plates to start from, rad.
        seed: Option<[f64; 3]>,
        /// Positions, q-units.
        q: [f64; 6],
    },
}

/// A [`Problem`].
pub fn kinematics(data: &[u8]) {
    match super::input(data) {
        Some(Problem::Three(three)) => three_is_solved(&three),
        Some(Problem::Six(six)) => six_is_solved(&six),
        Some(Problem::Anywhere {
            place,
            turn,
            seed,
            q,
        }) => anywhere(place, turn, seed, q),
        None => {}
    }
}

fn anywhere(place: [f64; 3], turn: [f64; 3], seed: Option<[f64; 3]>, q: [f64; 6]) {
    let (robot, three) = robots::l2(robots::l2_geometry()).unwrap();
    let [q1, q2, q3, ..] = q;
    check_is_right(&three, [q1, q2, q3]);
    inverse_is_inside(&three, place);
    inverse_in_assembly_is_inside(&three, place);
    forward_is_inside(&three, [q1, q2, q3]);
    lengths_are_kept(&robot, &three, place, [q1, q2, q3]);
    let six = robots::f1(robots::f1_geometry()).unwrap();
    let rotation = rotation_from_vector(&turn.into()).unwrap_or_else(|| [turn, turn, turn].into());
    let pose = Pose {
        position_m: place.into(),
        rotation,
    };
    six_link::check_is_right(&six, &q);
    answers_are_checked(&six, &pose, seed, &q);
    tracker_is_checked(&six, &Pose::at(robots::f1_home().into()), &[q]);
}
