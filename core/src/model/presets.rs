//! Example machines, those of `robots/l2.toml` and `robots/f1.toml`. Their dimensions are assumed:
//! plausible, not measured.

use nalgebra::Vector3;

use super::robot::{Branch, Compliances, LINKS};
use super::{f1, l2};

const fn v(x: f64, y: f64, z: f64) -> Vector3<f64> {
    Vector3::new(x, y, z)
}

/// Compliances of the links of both, m/N, link order; assumed.
const LINKS_M_PER_N: [f64; LINKS] = [5.0e-7, 6.0e-7, 5.5e-7, 7.0e-7, 6.5e-7, 6.0e-7];

/// Length of one unit of each `q` of the F1, m.
pub const F1_METRES_PER_Q: [f64; f1::AXES] = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1];

/// Geometry of the example L2, with its nominal travel.
#[must_use]
pub const fn l2() -> l2::Geometry {
    l2::Geometry {
        cart_joints_m: [
            v(0.10, -0.05, 1.28),
            v(-0.10, -0.29, 0.75),
            v(0.10, -0.29, 0.75),
            v(-0.12, -0.05, 0.05),
            v(0.12, -0.05, 0.05),
            v(0.00, 0.08, 0.05),
        ],
        guideways: [v(1.0, 0.0, 0.0); 3],
        platform_joints_m: [
            v(0.10, -0.05, 0.03),
            v(-0.10, 0.06, 0.05),
            v(0.10, 0.06, 0.05),
            v(-0.12, -0.05, -0.05),
            v(0.12, -0.05, -0.05),
            v(0.00, 0.08, -0.05),
        ],
        lengths_m: [1.0, 1.1, 1.0],
        configuration: l2::Configuration {
            inverse: [Branch::Positive, Branch::Negative, Branch::Positive],
            forward: Branch::Negative,
        },
        travel: Some([(-0.5, 2.0), (-2.0, 0.5), (-0.5, 2.0)]),
    }
}

/// Compliances of the example L2.
#[must_use]
pub const fn l2_compliances() -> Compliances<{ l2::AXES }> {
    Compliances {
        link_m_per_n: LINKS_M_PER_N,
        cart_m_per_n: [4.06e-8, 5.09e-8, 6.00e-8],
    }
}

/// Geometry of the example F1, with its nominal travel.
#[must_use]
pub const fn f1() -> f1::Geometry {
    let cart = (0.2, 3.0);
    let plate = (-0.04 / 0.1, 0.04 / 0.1);
    f1::Geometry {
        carts_m: [v(-0.25, -1.12, 0.0), v(1.15, 0.05, 0.0), v(-1.0, 0.55, 0.0)],
        guideways: [v(0.0, 0.0, 1.0); 3],
        plate_joints_m: [
            v(-0.05, -0.1, 0.02),
            v(0.0, -0.15, 0.0),
            v(0.0, 0.15, 0.0),
            v(0.11, -0.04, 0.0),
            v(-0.11, -0.04, 0.0),
            v(0.0, 0.1, 0.0),
        ],
        platform_joints_m: [
            v(-0.05, -0.1, 0.02),
            v(0.1, -0.15, 0.03),
            v(0.1, 0.15, 0.03),
            v(0.06, 0.1, 0.0),
            v(-0.16, 0.1, 0.0),
            v(-0.05, 0.24, 0.0),
        ],
        lengths_m: [1.7; LINKS],
        configuration: [Branch::Positive; 3],
        turn_axis: v(0.0, 0.0, 1.0),
        tilt_axis: v(0.0, 1.0, 0.0),
        turn_signs: [Branch::Negative, Branch::Positive],
        travel: Some([cart, cart, cart, plate, plate, plate]),
    }
}

/// Compliances of the example F1; of its carts measured `[T Table 5.3]`.
#[must_use]
pub const fn f1_compliances() -> Compliances<{ f1::AXES }> {
    Compliances {
        link_m_per_n: LINKS_M_PER_N,
        cart_m_per_n: [4.2081e-6, 7.5215e-6, 5.5578e-6, 2.0e-6, 2.0e-6, 2.0e-6],
    }
}
