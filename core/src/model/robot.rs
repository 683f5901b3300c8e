//! Parameters that both machines share, and the checks of them.
//!
//! Conventions `[T 3.1.1]`: link order 11, 21, 22, 31, 32, 33, the arm number being the number of
//! links in its cluster. `A_ij = A0_ij + q_i v_i` is the joint on the cart, in world axes;
//! `B_ij = T + R b_ij` the joint on the platform. `v_i` need be neither of unit length (its length
//! is the scale of `q_i`) nor parallel to the others.

use core::fmt;
use nalgebra::Vector3;

use crate::zip::zip;

/// Number of arms (carts, guideways).
pub const ARMS: usize = 3;
/// Number of links, in the order 11, 21, 22, 31, 32, 33.
pub const LINKS: usize = 6;
/// Index of the arm each link belongs to.
pub const ARM_OF_LINK: [usize; LINKS] = [0, 1, 1, 2, 2, 2];

/// Largest magnitude of any length of a machine, in metres. Everything the kinematics squares stays
/// far from overflow.
pub const MAX_LENGTH_M: f64 = 1e3;
/// Smallest and largest length of a guideway direction `v_i` (metres per unit of `q_i`).
pub const SCALE_RANGE: (f64, f64) = (1e-6, 1e3);
/// Largest compliance of a link or a cart, in m/N.
pub const MAX_COMPLIANCE_M_PER_N: f64 = 1.0;

/// A sign that chooses one of two solutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Branch {
    /// Sign +1.
    Positive,
    /// Sign -1.
    Negative,
}

impl Branch {
    /// The sign as a factor: +1.0 or -1.0.
    #[inline]
    #[must_use]
    pub const fn sign(self) -> f64 {
        match self {
            Self::Positive => 1.0,
            Self::Negative => -1.0,
        }
    }
}

/// Parameter that a [`RobotError`] names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Parameter {
    /// `A0`, a cart joint; the index is the link.
    CartJoint,
    /// `V`, a guideway direction; the index is the arm.
    Guideway,
    /// `b`, a platform joint; the index is the link.
    PlatformJoint,
    /// `L`, a link length; the index is the arm.
    Length,
    /// `travel`, a range of motion; the index is the arm.
    Travel,
    /// `c_link`, the compliance of a link; the index is the link.
    LinkCompliance,
    /// `c_cart`, the compliance of a cart; the index is the arm.
    CartCompliance,
    /// `C`, the origin of a cart; the index is the arm.
    Cart,
    /// `P`, a joint on a cart's plate; the index is the link.
    PlateJoint,
    /// `ax`, the axis that plates 2 and 3 turn about.
    TurnAxis,
    /// `ax6`, the axis that plate 3 tilts about.
    TiltAxis,
}

impl Parameter {
    /// The key of this parameter in robot files and in `solve` requests.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::CartJoint => "A0",
            Self::Guideway => "V",
            Self::PlatformJoint => "b",
            Self::Length => "L",
            Self::Travel => "travel",
            Self::LinkCompliance => "c_link",
            Self::CartCompliance => "c_cart",
            Self::Cart => "C",
            Self::PlateJoint => "P",
            Self::TurnAxis => "ax",
            Self::TiltAxis => "ax6",
        }
    }
}

/// Error in the parameters of a machine. Each variant names the parameter and its index.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RobotError {
    /// A number is NaN or infinite.
    NotFinite {
        /// Parameter.
        parameter: Parameter,
        /// Index of the link or arm.
        index: usize,
    },
    /// A magnitude lies outside its range.
    OutOfRange {
        /// Parameter.
        parameter: Parameter,
        /// Index of the link or arm.
        index: usize,
        /// Smallest magnitude accepted.
        lower: f64,
        /// Largest magnitude accepted.
        upper: f64,
    },
    /// The lower end of a range is above its upper end.
    Reversed {
        /// Parameter.
        parameter: Parameter,
        /// Index of the axis.
        index: usize,
    },
}

impl fmt::Display for RobotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { parameter, index } => {
                write!(f, "{}[{index}] is not finite", parameter.key())
            }
            Self::OutOfRange {
                parameter,
                index,
                lower,
                upper,
            } => {
                write!(
                    f,
                    "{}[{index}] must have a magnitude from {lower:e} to {upper:e}",
                    parameter.key()
                )
            }
            Self::Reversed { parameter, index } => {
                write!(
                    f,
                    "{}[{index}] has its lower end above its upper end",
                    parameter.key()
                )
            }
        }
    }
}

impl core::error::Error for RobotError {}

/// Compliances of links and carts `[T 3.3]`: elongation per tension, cart displacement per load.
/// Every one is positive.
///
/// The thesis lists negative link values (its Table 5.2); they are an artefact of an identification
/// that forbids the platform to turn, and are refused here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compliances<const N: usize> {
    pub(super) link_m_per_n: [f64; LINKS],
    pub(super) cart_m_per_n: [f64; N],
}

impl<const N: usize> Compliances<N> {
    /// Checks every compliance: `0 < c <= 1 m/N`. Links in link order, carts (and plates: rad/(N
    /// m)) in axis order.
    ///
    /// # Errors
    /// The first compliance that is not finite, not positive, or too large.
    pub fn new(link_m_per_n: [f64; LINKS], cart_m_per_n: [f64; N]) -> Result<Self, RobotError> {
        check_magnitudes(
            Parameter::LinkCompliance,
            &link_m_per_n,
            f64::MIN_POSITIVE,
            MAX_COMPLIANCE_M_PER_N,
        )?;
        check_magnitudes(
            Parameter::CartCompliance,
            &cart_m_per_n,
            f64::MIN_POSITIVE,
            MAX_COMPLIANCE_M_PER_N,
        )?;
        Ok(Self {
            link_m_per_n,
            cart_m_per_n,
        })
    }

    /// `c_ij`: elongation of each link per newton of tension, m/N, link order.
    #[inline]
    #[must_use]
    pub const fn link_m_per_n(&self) -> &[f64; LINKS] {
        &self.link_m_per_n
    }

    /// `c_i`: displacement of each cart along its guideway per newton of load, in q-units per
    /// newton of generalised load, axis order.
    #[inline]
    #[must_use]
    pub const fn cart_m_per_n(&self) -> &[f64; N] {
        &self.cart_m_per_n
    }

    /// `q - c tau`: the command whose axes stand at `q` (q-units) under these loads.
    pub(super) fn before_yielding(&self, q: &[f64; N], loads: &[f64; N]) -> [f64; N] {
        let mut command = *q;
        for (axis, (compliance, load)) in command.iter_mut().zip(zip(&self.cart_m_per_n, loads)) {
            *axis -= compliance * load;
        }
        command
    }
}

/// CRC-32 of the numbers' little-endian bits, zeros without their sign. The numbers of a machine
/// are those that turn positions of its axes into poses, and loads into positions: `metres_per_q`
/// is one of them.
pub(super) fn checksum(numbers: impl Iterator<Item = f64>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    for number in numbers {
        // -0.0 + 0.0 is +0.0.
        hasher.update(&(number + 0.0).to_bits().to_le_bytes());
    }
    hasher.finalize()
}

fn check_finite(parameter: Parameter, index: usize, value: f64) -> Result<(), RobotError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(RobotError::NotFinite { parameter, index })
    }
}

/// Checks the ranges of motion, axis by axis.
pub(super) fn check_travel<'a>(
    ranges: impl Iterator<Item = &'a (f64, f64)>,
) -> Result<(), RobotError> {
    let parameter = Parameter::Travel;
    for (index, (lower, upper)) in ranges.enumerate() {
        check_finite(parameter, index, *lower)?;
        check_finite(parameter, index, *upper)?;
        if lower > upper {
            return Err(RobotError::Reversed { parameter, index });
        }
    }
    Ok(())
}

/// Checks `lower <= value <= upper`, value by value, for quantities that must be positive.
pub(super) fn check_magnitudes(
    parameter: Parameter,
    values: &[f64],
    lower: f64,
    upper: f64,
) -> Result<(), RobotError> {
    for (index, value) in values.iter().enumerate() {
        check_finite(parameter, index, *value)?;
        if *value < lower || *value > upper {
            return Err(RobotError::OutOfRange {
                parameter,
                index,
                lower,
                upper,
            });
        }
    }
    Ok(())
}

/// Checks that the length of each vector is from `lower` to `upper`; squares are compared, which
/// needs no root.
pub(super) fn check_vectors(
    parameter: Parameter,
    vectors: &[Vector3<f64>],
    lower: f64,
    upper: f64,
) -> Result<(), RobotError> {
    for (index, vector) in vectors.iter().enumerate() {
        for component in vector.iter() {
            check_finite(parameter, index, *component)?;
        }
        let squared = vector.dot(vector);
        // The square of a huge finite component may be infinite, which is out of range too.
        if squared < lower * lower || squared > upper * upper {
            return Err(RobotError::OutOfRange {
                parameter,
                index,
                lower,
                upper,
            });
        }
    }
    Ok(())
}
