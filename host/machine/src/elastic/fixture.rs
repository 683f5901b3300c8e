//! Machines of the oracle's cases, for the tests of this folder.

use gantry_tau_test_support::vectors::{Case, Vectors};

use super::backlash::Backlash;
use super::springs::Springs;
use super::{ElasticMachine, Pose};

/// Pose of a case.
pub(crate) fn pose<const N: usize>(case: &Case<N>) -> Pose {
    Pose {
        translation_m: case.translation_m,
        rotation: case.rotation,
    }
}

/// Nominal compliances; no wrist.
pub(crate) fn springs<const N: usize>(vectors: &Vectors<N>) -> Springs<N> {
    Springs::rigid_wrist(vectors.compliances)
}

/// The machine with rigid joints and nominal compliances.
pub(crate) fn machine<const N: usize>(vectors: &Vectors<N>) -> ElasticMachine<N> {
    ElasticMachine::new(vectors.geometry, vectors.compliances, Backlash::NONE)
}
