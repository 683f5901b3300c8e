//! The page of `gantry-tau stability`.

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::stability::design::CUTOFFS_HZ;
use gantry_tau_machine::stability::survey::{MIN_MARGIN, Margins};
use gantry_tau_machine::stability::{Compensation, FilterKind, Place, StabilitySurvey};
use gantry_tau_report::page::{Page, Table};
use gantry_tau_report::plots::{Curve, Plot};
use gantry_tau_report::workspace::add_slices;
use nalgebra::Vector3;

use super::report::{Judged, NO_EIGENVALUES, WORKPIECES_N_PER_M, at, growths_in_contact};
use crate::cli::Failure;

/// Masses of tools that are judged, kg.
const TOOLS_KG: [f64; 8] = [0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0];
/// Gains that are judged in contact.
const GAINS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Range of cut-offs in which the margin is looked for, Hz, and the number of halvings.
const CUTOFF_HZ: (f64, f64) = (0.1, 30.0);
const HALVINGS: u32 = 12;

/// Returns the page; `text` is what the command prints.
pub(super) fn page<K: MachineKind<N>, const N: usize>(
    judged: &Judged<'_, K, N>,
    text: &str,
) -> Result<String, Failure> {
    let name = &judged.robot.name;
    let mut page = Page::new("gantry-tau stability", format!("Stability of {name}"));
    page.preformatted(text);
    add_tools(&mut page, judged)?;
    add_workpieces(&mut page, judged)?;
    add_travel(&mut page, judged);
    Ok(page.html())
}

/// A place with each of the tools.
fn with_tools<K, const N: usize>(
    judged: &Judged<'_, K, N>,
    at: &Place<N>,
) -> Result<Vec<(f64, Place<N>)>, Failure> {
    let places = TOOLS_KG.into_iter().map(|mass_kg| {
        let mut machine = *judged.machine;
        machine.masses.tool.mass_kg = mass_kg;
        Place::of(&machine, &at.pose, &at.axes, judged.compensation).map(|place| (mass_kg, place))
    });
    Ok(places.collect::<Option<_>>().ok_or(NO_EIGENVALUES)?)
}

fn add_tools<K, const N: usize>(page: &mut Page, judged: &Judged<'_, K, N>) -> Result<(), Failure> {
    let least = (judged.survey).worst(|place| place.margins.wrong_modes.any_phase);
    let places = with_tools(judged, least)?;
    let kind = judged.compensation.filter;
    page.section("Tool and cut-off");
    page.paragraph(format!(
        "Highest cut-off with a margin of {MIN_MARGIN} against any phase, in the place with the least margin, {} m: below a line the margin \
         is larger. The dot is this file.",
        at(least)
    ));
    let curves = vec![
        Curve::line(
            "modes as they are",
            contour(&places, &kind, |m| m.exact.any_phase)?,
        )
        .with_dots(),
        Curve::line(
            "modes 20 % wrong",
            contour(&places, &kind, |m| m.wrong_modes.any_phase)?,
        )
        .with_dots(),
        Curve::dots(
            "this file",
            vec![(judged.machine.masses.tool.mass_kg, kind.cutoff_hz())],
        )
        .in_ink(),
    ];
    let plot = Plot::new("Tool and cut-off", "tool, kg", "cut-off, Hz", curves);
    page.picture(&plot.svg());
    page.paragraph("Margin against any phase there, with the modes 20 % wrong:");
    let columns = CUTOFFS_HZ.map(|hz| format!("{hz} Hz"));
    let mut table = Table::new(std::iter::once("tool".to_owned()).chain(columns));
    for (mass_kg, place) in &places {
        let margins = CUTOFFS_HZ.map(|hz| {
            let (_, margins) = place.with_filter(&with_cutoff(&kind, hz))?;
            Some(format!("{:.2}", margins.wrong_modes.any_phase))
        });
        let margins = margins.into_iter().collect::<Option<Vec<_>>>();
        table.named_row(format!("{mass_kg} kg"), margins.ok_or(NO_EIGENVALUES)?);
    }
    page.table(table);
    Ok(())
}

/// Returns the highest cut-off with the required margin over the tool's mass.
fn contour<const N: usize>(
    places: &[(f64, Place<N>)],
    kind: &FilterKind,
    margin: fn(&Margins) -> f64,
) -> Result<Vec<(f64, f64)>, Failure> {
    places
        .iter()
        .map(|(mass_kg, place)| Ok((*mass_kg, highest_cutoff_hz(place, kind, margin)?)))
        .collect()
}

fn with_cutoff(kind: &FilterKind, hz: f64) -> FilterKind {
    match *kind {
        FilterKind::FirstOrder { .. } => FilterKind::FirstOrder { cutoff_hz: hz },
        FilterKind::SecondOrder { .. } => FilterKind::SecondOrder { cutoff_hz: hz },
        FilterKind::Auto {
            notches, notch_q, ..
        } => FilterKind::Auto {
            cutoff_hz: hz,
            notches,
            notch_q,
        },
    }
}

/// Returns the highest cut-off with the required margin; NaN if there is none in the range.
fn highest_cutoff_hz<const N: usize>(
    place: &Place<N>,
    kind: &FilterKind,
    margin: fn(&Margins) -> f64,
) -> Result<f64, Failure> {
    let (mut lower, mut upper) = CUTOFF_HZ;
    if !suffices(place, &with_cutoff(kind, lower), margin)? {
        return Ok(f64::NAN);
    }
    for _ in 0..HALVINGS {
        let middle = (lower * upper).sqrt();
        if suffices(place, &with_cutoff(kind, middle), margin)? {
            lower = middle;
        } else {
            upper = middle;
        }
    }
    Ok(lower)
}

fn suffices<const N: usize>(
    place: &Place<N>,
    kind: &FilterKind,
    margin: fn(&Margins) -> f64,
) -> Result<bool, Failure> {
    let (_, margins) = place.with_filter(kind).ok_or(NO_EIGENVALUES)?;
    Ok(margin(&margins) >= MIN_MARGIN)
}

fn add_workpieces<K, const N: usize>(
    page: &mut Page,
    judged: &Judged<'_, K, N>,
) -> Result<(), Failure> {
    page.section("Workpiece and gain");
    page.paragraph(
        "Growth of the loop with the tool at home on a workpiece, per second; below zero it decays. Of the four directions of contact that \
         in which it grows most.",
    );
    let mut curves = Vec::new();
    let mut growths = Vec::new();
    for gain in GAINS {
        let compensation = Compensation {
            gain,
            ..*judged.compensation
        };
        let home = &judged.survey.home;
        let home = Place::of(judged.machine, &home.pose, &home.axes, &compensation)
            .ok_or(NO_EIGENVALUES)?;
        let mut of_gain = [f64::MIN; WORKPIECES_N_PER_M.len()];
        for of_direction in growths_in_contact(&home, &compensation)? {
            for (most, growth) in of_gain.iter_mut().zip(of_direction) {
                *most = most.max(growth.per_s);
            }
        }
        let points = WORKPIECES_N_PER_M.map(f64::log10);
        let points = points.into_iter().zip(of_gain.iter().copied()).collect();
        curves.push(Curve::line(&format!("gain {gain}"), points).with_dots());
        growths.push(of_gain);
    }
    let plot = Plot::new(
        "Workpiece and gain",
        "stiffness, log10 of N/m",
        "growth, 1/s",
        curves,
    );
    page.picture(&plot.svg());
    let columns = GAINS.map(|gain| format!("gain {gain}"));
    let mut table = Table::new(std::iter::once("workpiece".to_owned()).chain(columns));
    for (row, stiffness) in WORKPIECES_N_PER_M.iter().enumerate() {
        let cells = (growths.iter())
            .filter_map(|of_gain| of_gain.get(row))
            .map(|growth| format!("{growth:+.2}"));
        table.named_row(format!("{stiffness:.0e} N/m"), cells);
    }
    page.table(table);
    Ok(())
}

fn add_travel<K, const N: usize>(page: &mut Page, judged: &Judged<'_, K, N>) {
    let survey = judged.survey;
    add_slices(
        page,
        &survey.grid,
        "Margin over the travel",
        "Against any phase, with the modes 20 % wrong. Along guideways that are all parallel nothing changes, and one place stands for all.",
        "margin",
        &unturned(survey, |place| place.margins.wrong_modes.any_phase),
    );
    add_slices(
        page,
        &survey.grid,
        "Lowest mode over the travel",
        "Natural frequency with the drives held.",
        "Hz",
        &unturned(survey, |place| {
            place.modes_hz.first().copied().unwrap_or(f64::NAN)
        }),
    );
    let mut table = Table::new(["place, m", "lowest mode, Hz", "margin", "modes 20 % wrong"]);
    for place in &survey.places {
        let lowest_hz = place.modes_hz.first().copied().unwrap_or(f64::NAN);
        table.named_row(
            at(place),
            [
                format!("{lowest_hz:.1}"),
                format!("{:.2}", place.margins.exact.any_phase),
                format!("{:.2}", place.margins.wrong_modes.any_phase),
            ],
        );
    }
    page.table(table);
}

/// Returns a value of every place where the platform is not turned.
fn unturned<const N: usize>(
    survey: &StabilitySurvey<N>,
    of: fn(&Place<N>) -> f64,
) -> Vec<(Vector3<f64>, f64)> {
    (survey.places.iter())
        .filter(|place| place.pose.rotation.angle() < 1e-6)
        .map(|place| (place.pose.translation_m, of(place)))
        .collect()
}
