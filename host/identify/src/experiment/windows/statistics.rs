//! Slope and mean of samples of which neighbours are alike.

/// Least number of samples that statistics are made of.
pub(super) const MIN_SAMPLES: usize = 10;

/// Slope of a straight line through samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slope {
    pub(super) per_s: f64,
    pub(super) error_per_s: f64,
}

impl Slope {
    /// Fits samples of (time in s, value); `None` for too few.
    pub(super) fn of(samples: &[(f64, f64)]) -> Option<Self> {
        if samples.len() < MIN_SAMPLES {
            return None;
        }
        let count = samples.len() as f64;
        let middle_s = samples.iter().map(|(time, _)| time).sum::<f64>() / count;
        let middle = samples.iter().map(|(_, value)| value).sum::<f64>() / count;
        let spread: f64 = samples
            .iter()
            .map(|(time, _)| (time - middle_s).powi(2))
            .sum();
        let per_s = samples
            .iter()
            .map(|(time, value)| (time - middle_s) * (value - middle))
            .sum::<f64>()
            / spread;
        let left: Vec<f64> = samples
            .iter()
            .map(|(time, value)| value - middle - per_s * (time - middle_s))
            .collect();
        let alike = count / effective(&left);
        let squares: f64 = left.iter().map(|value| value * value).sum();
        Some(Self {
            per_s,
            error_per_s: (squares / (count - 2.0) * alike / spread).sqrt(),
        })
    }
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub(super) fn variance(values: &[f64], mean: f64) -> f64 {
    values
        .iter()
        .map(|value| (value - mean).powi(2))
        .sum::<f64>()
        / (values.len() as f64 - 1.0)
}

/// Returns the effective number of samples, `n / (1 + 2 sum rho_k)`, up to the first correlation
/// that is not positive; from 1 to `n`.
pub(super) fn effective(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = mean(values);
    let off: Vec<f64> = values.iter().map(|value| value - mean).collect();
    let squares: f64 = off.iter().map(|value| value * value).sum();
    if squares <= 0.0 {
        return count;
    }
    let correlations = (1..values.len() / 4).map(|lag| {
        let products = off.iter().zip(off.iter().skip(lag)).map(|(a, b)| a * b);
        products.sum::<f64>() / squares
    });
    let alike: f64 = correlations.take_while(|rho| *rho > 0.0).sum();
    (count / (1.0 + 2.0 * alike)).clamp(1.0, count)
}
