//! Columns of the wrench with a wrong sign or unit: looked for where a campaign is not explained as it is, and told by the fit without them.

use crate::measurements::FileError;
use crate::measurements::springs::{Campaign, LOAD};
use crate::springs::lines::Question;

use super::doubts::MOST_OUTLIERS;
use super::{Found, IdentifyError, IdentifyOptions, find};
use crate::fit::statistics::float;

/// Chi-squared per degree of freedom up to which a campaign counts as explained.
const EXPLAINED: f64 = 1.5;
/// Newtons of a kilogram's weight.
const NEWTONS_PER_KG: f64 = 9.806_65;
/// Forces, moments and all of the wrench.
const FORCES: [usize; 3] = [0, 1, 2];
const MOMENTS: [usize; 3] = [3, 4, 5];
const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

/// Columns whose values are to be multiplied, and the sentence for it.
struct Mistake {
    columns: Vec<usize>,
    factor: f64,
    reason: &'static str,
}

impl Mistake {
    fn all() -> impl Iterator<Item = Self> {
        let of =
            |columns: &[usize], factor: f64, reason: &'static str| Self { columns: columns.to_vec(), factor, reason };
        let reversed = "the wrench has the wrong sign: it is the load on the platform, not what the platform pulls with; negate these columns";
        let groups = [
            of(&ALL, -1.0, reversed),
            of(&FORCES, -1.0, "the forces have the wrong sign; negate these columns"),
            of(&MOMENTS, -1.0, "the moments have the wrong sign; negate these columns"),
            of(&FORCES, NEWTONS_PER_KG, "the forces are in kg; write newtons: 9.80665 times as much"),
            of(&FORCES, 1e3, "the forces are in kN; write newtons"),
            of(&MOMENTS, 1e-3, "the moments are in N mm; write N m"),
        ];
        let single = ALL.map(|column| of(&[column], -1.0, "this column has the wrong sign; negate it"));
        groups.into_iter().chain(single)
    }

    fn taken_back<const N: usize>(&self, campaign: &Campaign<N>) -> Campaign<N> {
        let mut campaign = campaign.clone();
        for window in &mut campaign.windows {
            self.columns.iter().for_each(|column| window.load[*column] *= self.factor);
        }
        campaign
    }

    fn names(&self) -> String {
        self.columns.iter().map(|column| LOAD[*column]).collect::<Vec<_>>().join(", ")
    }
}

/// Returns what was found; if that does not explain the campaign, and would if the wrench were another, the error that says which.
///
/// # Errors
/// That of `found`, or the mistake.
pub(super) fn checked<'a, const N: usize>(
    found: Result<Found<'a, N>, IdentifyError>,
    question: &Question<'_, N>,
    options: &IdentifyOptions,
) -> Result<Found<'a, N>, IdentifyError> {
    if found.as_ref().is_ok_and(is_explained) {
        return found;
    }
    let plain = IdentifyOptions { has_two_regimes: false, has_hysteresis: false, ..options.clone() };
    let explains = |mistake: &Mistake| {
        let campaign = mistake.taken_back(question.campaign);
        let question = Question { campaign: &campaign, setup: question.setup.clone(), ..*question };
        find(question, &plain).is_ok_and(|found| is_explained(&found))
    };
    let window = question.campaign.windows.first();
    match (Mistake::all().find(explains), window) {
        (Some(mistake), Some(window)) => {
            let error: FileError = question.campaign.error(window, &mistake.names(), mistake.reason);
            Err(error.into())
        }
        _ => found,
    }
}

fn is_explained<const N: usize>(found: &Found<'_, N>) -> bool {
    let agreement = &found.agreement;
    let readings = agreement.solved.rows.residuals.len() + agreement.refused.len();
    agreement.solved.rows.chi_squared() <= EXPLAINED * float(agreement.solved.degrees())
        && float(agreement.refused.len()) <= MOST_OUTLIERS * float(readings)
}
