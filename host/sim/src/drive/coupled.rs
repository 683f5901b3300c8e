//! Motors of one axis that are bodies of their own in front of their cart: play, and a bias against
//! it `[T 1.2.2]`.
//!
//! Each drive runs its loops on the mean position of the motors, so that they do not fight over a
//! micrometre, and adds its bias: one half pushes forwards, the other backwards. Within the play
//! nothing touches; with a bias above half the load both flanks do.

use super::motor::Cart;
use super::{Drive, SUBSTEPS, mean};

/// Runs one cycle of the drives of an axis and of its cart, under `load_n` newtons on the cart.
/// `is_of_axis` tells a drive by its number.
pub fn advance(
    drives: &mut [Drive],
    is_of_axis: impl Fn(usize) -> bool + Copy,
    cart: &mut Cart,
    load_n: f64,
) {
    of_axis(drives, is_of_axis).for_each(Drive::begin);
    for substep in 0..SUBSTEPS {
        step(drives, is_of_axis, cart, substep, load_n);
    }
    of_axis(drives, is_of_axis).for_each(Drive::end);
}

/// Runs one of the [`SUBSTEPS`] of a cycle of the drives of an axis and of its
/// cart, under `load_n` newtons on the cart. `is_of_axis` tells a drive by its number.
pub(crate) fn step(
    drives: &mut [Drive],
    is_of_axis: impl Fn(usize) -> bool + Copy,
    cart: &mut Cart,
    substep: u32,
    load_n: f64,
) {
    let Some(settings) = of_axis(drives, is_of_axis)
        .next()
        .map(|drive| drive.settings)
    else {
        return;
    };
    for drive in of_axis(drives, is_of_axis) {
        drive.measured = drive.measure();
    }
    let position_m = mean(of_axis(drives, is_of_axis).map(|drive| drive.measured.0));
    let velocity_m_per_s = mean(of_axis(drives, is_of_axis).map(|drive| drive.measured.1));
    let measured = (position_m, velocity_m_per_s);
    let (mut forces_n, mut motors) = (load_n, 0.0);
    for drive in of_axis(drives, is_of_axis) {
        forces_n += drive.push(substep, measured, cart);
        motors += 1.0;
    }
    cart.advance(forces_n, motors, &settings);
}

/// The drives of an axis.
fn of_axis(
    drives: &mut [Drive],
    is_of_axis: impl Fn(usize) -> bool,
) -> impl Iterator<Item = &mut Drive> {
    drives
        .iter_mut()
        .enumerate()
        .filter(move |(number, _)| is_of_axis(*number))
        .map(|(_, drive)| drive)
}
