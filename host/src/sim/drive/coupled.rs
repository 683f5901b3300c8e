//! Motors of one axis that are bodies of their own in front of their cart: play, and a bias against it `[T 1.2.2]`.
//!
//! Each drive runs its loops on the mean position of the motors, so that they do not fight over a micrometre, and adds its bias: one
//! half pushes forwards, the other backwards. Within the play nothing touches; with a bias above half the load both flanks do.

use super::encoder::Motion;
use super::motor::Cart;
use super::{Drive, SUBSTEPS, mean};

/// Runs one cycle of the drives of an axis and of its cart, under `load_n` newtons on the cart. `is_of_axis` tells a drive by its number.
pub fn advance(drives: &mut [Drive], is_of_axis: impl Fn(usize) -> bool + Copy, cart: &mut Cart, load_n: f64) {
    let of_axis = |(number, _): &(usize, &mut Drive)| is_of_axis(*number);
    let Some(friction) = drives.first().map(|drive| drive.settings.friction) else { return };
    drives.iter_mut().enumerate().filter(of_axis).for_each(|(_, drive)| drive.begin());
    for substep in 0..SUBSTEPS {
        for (_, drive) in drives.iter_mut().enumerate().filter(of_axis) {
            drive.measured = drive.measure();
        }
        let mean_of = |of: fn(&Motion) -> f64| {
            let mine = drives.iter().enumerate().filter(|(number, _)| is_of_axis(*number));
            mean(mine.map(|(_, drive)| of(&drive.measured)))
        };
        let measured = (mean_of(|motion| motion.0), mean_of(|motion| motion.1));
        let (mut forces_n, mut motors) = (load_n, 0.0);
        for (_, drive) in drives.iter_mut().enumerate().filter(of_axis) {
            forces_n += drive.push(substep, measured, cart);
            motors += 1.0;
        }
        cart.advance(forces_n, motors, &friction);
    }
    drives.iter_mut().enumerate().filter(of_axis).for_each(|(_, drive)| drive.end());
}
