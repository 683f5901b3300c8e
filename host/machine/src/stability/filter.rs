//! Filters of the load: sections in a row, each of second order at most.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use nalgebra::{Complex, ComplexField};

use crate::drive_cascade::CYCLE_S;

/// Longest time that a step response is followed, s.
pub const MAX_SETTLING_S: f64 = 20.0;

/// `b_0 + b_1 z^-1 + b_2 z^-2` over `1 + a_1 z^-1 + a_2 z^-2`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

/// Past of a section.
pub type Past = [f64; 2];

/// Sections in a row, one sample per cycle.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Filter {
    sections: Vec<Section>,
}

impl Filter {
    /// Low-pass of first order by backward Euler, as of the force sensor's reading
    /// ([`gantry_tau_core::model::sensor`]).
    #[must_use]
    pub fn first_order(cutoff_hz: f64) -> Self {
        let u = TAU * cutoff_hz * CYCLE_S;
        let share = u / (1.0 + u);
        Self {
            sections: vec![Section {
                b: [share, 0.0, 0.0],
                a: [share - 1.0, 0.0],
            }],
        }
    }

    /// Butterworth low-pass of second order.
    #[must_use]
    pub fn butterworth(cutoff_hz: f64) -> Self {
        let k = (PI * cutoff_hz * CYCLE_S).tan();
        Self {
            sections: vec![Section::trapezoidal(
                k,
                FRAC_1_SQRT_2,
                [k * k, 2.0 * k * k, k * k],
            )],
        }
    }

    /// The same with a notch behind it.
    #[must_use]
    pub fn with_notch(mut self, hz: f64, q: f64) -> Self {
        let k = (PI * hz * CYCLE_S).tan();
        let numerator = [1.0 + k * k, 2.0 * (k * k - 1.0), 1.0 + k * k];
        self.sections.push(Section::trapezoidal(k, q, numerator));
        self
    }

    /// Returns the response at a frequency, by `z = e^jw`.
    #[must_use]
    pub fn response(&self, z: Complex<f64>) -> Complex<f64> {
        let back = z.inv();
        self.sections
            .iter()
            .map(|section| section.response(back))
            .product()
    }

    /// Returns the magnitude of the response at a frequency, Hz.
    #[must_use]
    pub fn gain(&self, hz: f64) -> f64 {
        let (sin, cos) = (TAU * hz * CYCLE_S).sin_cos();
        self.response(Complex::new(cos, sin)).modulus()
    }

    /// Returns the time after a step from which on the output stays within a share of it, s; at
    /// most [`MAX_SETTLING_S`].
    #[must_use]
    pub fn settling_s(&self, share: f64) -> f64 {
        let mut past = vec![Past::default(); self.order()];
        let mut settled = 0;
        let cycles = (MAX_SETTLING_S / CYCLE_S) as u32;
        for cycle in 1..=cycles {
            if (self.next(&mut past, 1.0) - 1.0).abs() > share {
                settled = cycle;
            }
        }
        f64::from(settled) * CYCLE_S
    }

    /// Number of sections.
    #[must_use]
    pub fn order(&self) -> usize {
        self.sections.len()
    }

    /// Takes a sample; `past` has one entry per section, zero at first.
    pub fn next(&self, past: &mut [Past], sample: f64) -> f64 {
        let in_row = self.sections.iter().zip(past);
        in_row.fold(sample, |x, (Section { b, a }, past)| {
            let y = b[0] * x + past[0];
            *past = [b[1] * x - a[0] * y + past[1], b[2] * x - a[1] * y];
            y
        })
    }
}

impl Section {
    /// Returns the response by `z^-1`.
    fn response(&self, back: Complex<f64>) -> Complex<f64> {
        let Self { b, a } = self;
        let numerator = back * (back * b[2] + b[1]) + b[0];
        numerator / (back * (back * a[1] + a[0]) + 1.0)
    }

    /// Section by the trapezoidal rule, exact at its frequency: `k = tan(pi f T)`.
    fn trapezoidal(k: f64, q: f64, numerator: [f64; 3]) -> Self {
        let scale = 1.0 + k / q + k * k;
        Self {
            b: numerator.map(|b| b / scale),
            a: [2.0 * (k * k - 1.0) / scale, (1.0 - k / q + k * k) / scale],
        }
    }
}
