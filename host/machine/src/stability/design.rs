//! Choice of a filter, and of the largest tool, over the reach of a machine.

use super::survey::{Margins, in_parallel};
use super::{Compensation, FilterKind, Place, StabilitySurvey};
use crate::dynamics::MassiveMachine;

/// Cut-offs that are tried, Hz.
pub const CUTOFFS_HZ: [f64; 9] = [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0];
/// Numbers of notches that are tried.
const NOTCHES: [usize; 3] = [0, 1, 2];
/// Share of a step that a settled offset is within.
pub const SETTLED: f64 = 0.05;
/// Heaviest tool that is looked for, kg.
pub const MAX_TOOL_KG: f64 = 100.0;
/// Lightest tool that is tried, kg.
const MIN_TOOL_KG: f64 = 0.1;
/// Tools that are tried beside it, at equal ratios: a margin does not fall evenly with the mass.
const TOOLS: u32 = 16;
/// Halvings of the range between the last that suffices and the next: to a percent.
const HALVINGS: u32 = 5;

/// A filter that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriedFilter {
    /// The filter.
    pub kind: FilterKind,
    /// Time to 5 % of a step of the load at home, s.
    pub settles_s: f64,
    /// Smallest margins over all places.
    pub margins: Margins,
}

/// Tries filters of second order of each of [`CUTOFFS_HZ`], with none to two notches of this Q, in
/// the places of a survey. `None` if eigenvalues are not found.
#[must_use]
pub fn try_filters<const N: usize>(
    survey: &StabilitySurvey<N>,
    notch_q: f64,
) -> Option<Vec<TriedFilter>> {
    let kinds = CUTOFFS_HZ.into_iter().flat_map(|cutoff_hz| {
        NOTCHES.map(|notches| match notches {
            0 => FilterKind::SecondOrder { cutoff_hz },
            notches => FilterKind::Auto {
                cutoff_hz,
                notches,
                notch_q,
            },
        })
    });
    kinds.map(|kind| try_filter(survey, kind)).collect()
}

fn try_filter<const N: usize>(
    survey: &StabilitySurvey<N>,
    kind: FilterKind,
) -> Option<TriedFilter> {
    let (at_home, mut margins) = survey.home.with_filter(&kind)?;
    for place in &survey.places {
        margins = margins.least(&place.with_filter(&kind)?.1);
    }
    Some(TriedFilter {
        kind,
        settles_s: at_home.settling_s(SETTLED),
        margins,
    })
}

/// Returns the fastest of the filters whose margins suffice.
#[must_use]
pub fn fastest(tried: &[TriedFilter]) -> Option<&TriedFilter> {
    (tried.iter())
        .filter(|filter| filter.margins.suffice())
        .min_by(|one, other| one.settles_s.total_cmp(&other.settles_s))
}

/// Returns the largest mass of a tool up to which all that are tried have sufficient margins in these
/// places, kg, up to [`MAX_TOOL_KG`]; `None` if no tool is light enough.
#[must_use]
pub fn heaviest_tool_kg<const N: usize>(
    machine: &MassiveMachine<N>,
    compensation: &Compensation<N>,
    places: &[&Place<N>],
) -> Option<f64> {
    let suffices = |mass_kg| suffices(machine, compensation, places, mass_kg);
    let mut lower = None;
    for step in (0..=TOOLS).rev() {
        let share = f64::from(step) / f64::from(TOOLS);
        let mut upper = MAX_TOOL_KG * (MIN_TOOL_KG / MAX_TOOL_KG).powf(share);
        if suffices(upper) {
            lower = Some(upper);
            continue;
        }
        let mut lower = lower?;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (lower + upper);
            if suffices(middle) {
                lower = middle;
            } else {
                upper = middle;
            }
        }
        return Some(lower);
    }
    lower
}

/// True if the margins suffice in these places with a tool of this mass, kg.
fn suffices<const N: usize>(
    machine: &MassiveMachine<N>,
    compensation: &Compensation<N>,
    places: &[&Place<N>],
    mass_kg: f64,
) -> bool {
    let mut machine = *machine;
    machine.masses.tool.mass_kg = mass_kg;
    let judged = in_parallel(places, |place| {
        Place::of(&machine, &place.pose, &place.axes, compensation)
            .is_some_and(|place| place.margins.suffice())
    });
    judged.into_iter().all(|suffices| suffices)
}
