//! Residuals of a fit beside the stated noise.

use super::statistics::{chi_squared_above, float};

/// Smallest probability of a chi-squared, on either side, at which model and stated noise are
/// believed.
pub(crate) const MIN_P: f64 = 1e-3;
/// Factor by which noise may be stated too large without a word: intervals are wider than they need
/// be.
const MAX_OVERSTATED: f64 = 1.25;
/// Factor above which a message does not name it.
const MUCH: f64 = 100.0;
/// Probability below which its digits are those of rounding.
const ROUNDING: f64 = 1e-15;

/// Says that the residuals are larger than the stated noise lets them be.
pub(crate) fn too_large(chi2: f64, degrees: usize) -> Option<String> {
    let p = chi_squared_above(chi2, degrees);
    (p < MIN_P).then(|| {
        format!(
            "the model or the stated noise is wrong: chi2/dof is {:.2} ({})",
            chi2 / float(degrees),
            p_value_text(p)
        )
    })
}

/// Says that the residuals are smaller than the stated noise lets them be.
pub(crate) fn too_small(chi2: f64, degrees: usize) -> Option<String> {
    let below = 1.0 - chi_squared_above(chi2, degrees);
    let factor = (float(degrees) / chi2).sqrt();
    (below < MIN_P && factor > MAX_OVERSTATED).then(|| {
        let factor = if factor < MUCH { format!("{factor:.1}") } else { format!("more than {MUCH}") };
        format!(
            "the stated noise is {factor} times too large: chi2/dof is {:.2} ({}); check its units, and those of the measurements",
            chi2 / float(degrees),
            p_value_text(below)
        )
    })
}

/// The first of some explanations, the simplest first, that none after it beats by this
/// chi-squared.
pub(crate) fn simplest<T>(
    explanations: impl Iterator<Item = (f64, T)>,
    least_gain: f64,
) -> Option<T> {
    explanations
        .reduce(|one, other| {
            if other.0 < one.0 - least_gain {
                other
            } else {
                one
            }
        })
        .map(|(_, best)| best)
}

/// A probability as sentences have it.
pub(crate) fn p_value_text(p: f64) -> String {
    if p < ROUNDING {
        "p = 0 to 15 digits".to_owned()
    } else {
        format!("p = {p:.1e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_simpler_explanation_is_beaten_by_a_far_better_one_only() {
        fn best(chi2: [f64; 3]) -> Option<&'static str> {
            simplest(chi2.into_iter().zip(["simple", "other", "third"]), 20.0)
        }
        assert_eq!(best([100.0, 90.0, 81.0]), Some("simple"));
        assert_eq!(best([100.0, 79.0, 60.0]), Some("other"));
        assert_eq!(simplest(std::iter::empty::<(f64, ())>(), 20.0), None);
    }

    #[test]
    fn both_sides_have_their_sentences() {
        assert_eq!((too_large(100.0, 100), too_small(100.0, 100)), (None, None));
        assert_eq!(
            (too_large(0.0, 0), too_small(0.0, 0)),
            (None, None),
            "nothing is left to judge"
        );
        assert!(
            too_large(150.0, 100)
                .unwrap()
                .contains("chi2/dof is 1.50 (p = 9")
        );
        assert!(
            too_small(45.0, 100)
                .unwrap()
                .starts_with("the stated noise is 1.5 times too large")
        );
        assert!(
            too_small(0.0, 10)
                .unwrap()
                .starts_with("the stated noise is more than 100 times too large")
        );
        // Significant, and no matter; and a matter, but not significant.
        assert_eq!(
            (
                too_small(900.0, 1_100),
                too_small(1.0, 4),
                too_small(0.0, 0)
            ),
            (None, None, None)
        );
    }
}
