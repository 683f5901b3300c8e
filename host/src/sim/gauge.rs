//! Length gauges on the tool: Heidenhain ST 3000, three of them along the world axes `[T 4.2.6]`.

use super::parameters::{SimulationError, check};

/// An incremental gauge: it shows whole steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gauge {
    resolution_m: f64,
}

impl Gauge {
    /// Creates a gauge with steps of `resolution_m` metres.
    ///
    /// # Errors
    /// [`SimulationError::OutOfRange`] unless the step is from a picometre to a metre.
    pub fn new(resolution_m: f64) -> Result<Self, SimulationError> {
        check("gauge_resolution_m", resolution_m, 1e-12, 1.0)?;
        Ok(Self { resolution_m })
    }

    /// Returns the nearest whole step, in metres.
    #[must_use]
    pub fn show(&self, length_m: f64) -> f64 {
        (length_m / self.resolution_m).round() * self.resolution_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shows_whole_steps_within_half_a_step() {
        let gauge = Gauge::new(0.5e-6).unwrap();
        for nanometre in -3000..3000 {
            let length = f64::from(nanometre) * 1e-9;
            let shown = gauge.show(length);
            let steps = shown / 0.5e-6;
            assert!((steps - steps.round()).abs() < 1e-9);
            assert!((shown - length).abs() <= 0.25e-6 + 1e-15);
        }
    }

    #[test]
    fn refuses_a_step_of_nothing() {
        for bad in [0.0, -1e-6, f64::NAN, f64::INFINITY] {
            assert!(Gauge::new(bad).is_err());
        }
    }
}
