//! Quantiles and probabilities. Thin names for those of statrs.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, Normal, StudentsT};

/// Half-width of a central 95 % interval of a standard normal variable.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;

/// Returns the probability that chi-squared of `degrees` of freedom is `value` or more; 1 without a
/// degree of freedom.
#[must_use]
pub fn chi_squared_above(value: f64, degrees: usize) -> f64 {
    ChiSquared::new(float(degrees)).map_or(1.0, |law| law.sf(value))
}

/// Returns the value that chi-squared of `degrees` of freedom stays below with probability `p`.
#[must_use]
pub fn chi_squared_quantile(p: f64, degrees: usize) -> f64 {
    ChiSquared::new(float(degrees)).map_or(0.0, |law| law.inverse_cdf(p))
}

/// Returns the probability that a ratio of variances of these degrees of freedom is `value` or
/// more; 1 without a degree of freedom.
#[must_use]
pub fn f_above(value: f64, numerator: usize, denominator: usize) -> f64 {
    FisherSnedecor::new(float(numerator), float(denominator)).map_or(1.0, |law| law.sf(value))
}

/// Returns the half-width of a central 95 % interval of Student's t; infinite without a degree of
/// freedom.
#[must_use]
pub fn students_t_95(degrees: usize) -> f64 {
    StudentsT::new(0.0, 1.0, float(degrees)).map_or(f64::INFINITY, |law| law.inverse_cdf(0.975))
}

/// Returns the value that a standard normal variable stays below with probability `p`.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p)
}

/// Returns the probability that a standard normal variable is below `value`.
#[must_use]
pub fn normal_below(value: f64) -> f64 {
    Normal::standard().cdf(value)
}

/// Sum of the squares of the deviations of some values from their mean.
#[must_use]
pub fn squares_about_mean(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / float(values.len().max(1));
    values.iter().map(|value| (value - mean).powi(2)).sum()
}

/// Returns the median; NaN of nothing.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match (values.get(middle.wrapping_sub(1)), values.get(middle)) {
        (Some(below), Some(above)) if values.len() % 2 == 0 => f64::midpoint(*below, *above),
        (_, Some(value)) => *value,
        _ => f64::NAN,
    }
}

/// A count as a float; exact up to 2^53.
#[must_use]
pub fn float(count: usize) -> f64 {
    count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f64, table: f64) {
        assert!((found / table - 1.0).abs() < 5e-5, "{found} {table}");
    }

    /// Abramowitz and Stegun, tables 26.8 to 26.10, and the normal's 26.1.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        close(normal_quantile(0.975), NORMAL_95);
        close(normal_below(-1.0), 0.158_655);
        close(chi_squared_quantile(0.95, 1), 3.841_46);
        close(chi_squared_quantile(0.999, 10), 29.588_3);
        close(chi_squared_above(3.841_46, 1), 0.05);
        close(students_t_95(1), 12.706_2);
        close(students_t_95(10), 2.228_14);
        close(f_above(4.964_60, 1, 10), 0.05);
        assert!(
            chi_squared_above(1.0, 0) >= 1.0
                && students_t_95(0).is_infinite()
                && f_above(9.0, 1, 0) >= 1.0
        );
    }

    #[test]
    fn the_median_is_the_middle() {
        assert!((median(vec![3.0, 1.0, 2.0]) - 2.0).abs() < 1e-15);
        assert!((median(vec![4.0, 1.0, 2.0, 3.0]) - 2.5).abs() < 1e-15);
        assert!(median(Vec::new()).is_nan());
    }
}
