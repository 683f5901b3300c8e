//! Compensation against a workpiece.

use nalgebra::Vector3;

use super::Compliance;
use crate::model::kinematics::KinematicsError;
use crate::model::linalg::{times, unit};

/// Loop gain of force compensation while the tool touches a workpiece:
/// `g n.C'n / (n.C n + 1 / k_e)`, below 1 where it is stable.
///
/// The tool pushes with the force `F`; the compensation moves the reference by `g C' F` towards the
/// workpiece, which raises the force by that over the compliance of machine and workpiece in
/// series. This is positive feedback: each round the force grows by this factor. How far it is
/// below 1 is the margin, and with a free tool (`k_e = 0`) nothing is fed back at all.
///
/// - `gain`: `g`, the share that is compensated;
/// - `estimated`: `C'`, what the compensation computes with; `machine`: `C`, what the machine has;
///   both about the point of contact;
/// - `normal`: `n`, the direction of contact, world axes, of any length;
/// - `workpiece_n_per_m`: `k_e`.
///
/// *Assumed*: one point of contact, without friction; small displacements; everything slower than
/// machine and workpiece vibrate, so that filter and delay only slow the growth or decay down. A
/// margin here is necessary, not sufficient.
///
/// # Errors
/// [`KinematicsError::NotFinite`] for a direction without length, a negative stiffness, or numbers
/// that are not finite.
pub fn contact_loop_gain(
    gain: f64,
    estimated: &Compliance,
    machine: &Compliance,
    normal: &Vector3<f64>,
    workpiece_n_per_m: f64,
) -> Result<f64, KinematicsError> {
    let n = unit(normal).ok_or(KinematicsError::NotFinite)?;
    // k / (1 + c k) is 1 / (c + 1 / k), and takes k = 0.
    let series = workpiece_n_per_m / (1.0 + along(machine, &n) * workpiece_n_per_m);
    let loop_gain = gain * along(estimated, &n) * series;
    if loop_gain.is_finite() && workpiece_n_per_m >= 0.0 {
        Ok(loop_gain)
    } else {
        Err(KinematicsError::NotFinite)
    }
}

/// Displacement along a unit vector per force along it, m/N.
fn along(compliance: &Compliance, direction: &Vector3<f64>) -> f64 {
    direction.dot(&times(&compliance.translation(), direction))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix6;

    fn compliance(m_per_n: f64) -> Compliance {
        Compliance(Matrix6::identity() * m_per_n)
    }

    /// The force in contact, round after round, of springs that are stepped by hand.
    fn force_after(rounds: u32, gain: f64, estimated: f64, machine: f64, workpiece: f64) -> f64 {
        let series = 1.0 / (machine + 1.0 / workpiece);
        let mut reference_m = 1e-4;
        let mut force_n = 0.0;
        for _ in 0..rounds {
            force_n = series * reference_m;
            reference_m = 1e-4 + gain * estimated * force_n;
        }
        force_n
    }

    #[test]
    fn what_is_below_one_settles() {
        let normal = Vector3::new(0.0, 3.0, 4.0);
        for (gain, estimated, machine, workpiece) in [
            (1.0, 5e-7, 5e-7, 1e6),
            (1.0, 9e-7, 5e-7, 1e6),
            (1.0, 2e-6, 5e-7, 1e6),
            (0.5, 2e-6, 5e-7, 1e6),
            (1.0, 6e-7, 5e-7, 1e9),
        ] {
            let [ours, theirs] = [estimated, machine].map(compliance);
            let loop_gain = contact_loop_gain(gain, &ours, &theirs, &normal, workpiece).unwrap();
            let [soon, late] =
                [200, 400].map(|rounds| force_after(rounds, gain, estimated, machine, workpiece));
            assert_eq!(
                loop_gain < 1.0,
                (late - soon).abs() < 1e-3 * soon,
                "{loop_gain} {soon} {late}"
            );
        }
    }

    #[test]
    fn a_free_tool_feeds_nothing_back() {
        let c = compliance(5e-7);
        assert_eq!(contact_loop_gain(1.0, &c, &c, &Vector3::x(), 0.0), Ok(0.0));
        for wild in [f64::NAN, f64::INFINITY, -1.0] {
            assert!(contact_loop_gain(1.0, &c, &c, &Vector3::x(), wild).is_err());
        }
        assert!(contact_loop_gain(1.0, &c, &c, &Vector3::zeros(), 1e6).is_err());
    }
}
