//! Readings that a fit uses, and unknowns that it has besides the springs.

use super::beyond::Beyond;
use crate::fit::held::Held;
use crate::measurements::springs::Campaign;

/// Readings that a fit uses, and unknowns that it has besides the springs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Choice {
    /// Weight of each reading by window and gauge, which divides its variance; 0: it is not used.
    pub(crate) weights: Vec<Vec<f64>>,
    /// Gauges that somebody moved.
    pub(crate) shifts: Vec<Shift>,
    /// Windows beyond the jump. The play is fitted if there are any.
    pub(crate) is_crossed: Vec<bool>,
    /// Model of the links there.
    pub(crate) beyond: Beyond,
    /// Gauges whose half-width of the hysteresis is fitted.
    pub(crate) hysteresis: Vec<usize>,
    /// A drift of each gauge in each series is fitted.
    pub(crate) has_drift: bool,
    /// Directions that no step goes along, of the springs; `None`: those that are lost where a step begins.
    pub(crate) held: Option<Held>,
}

/// A gauge that stays shifted from a window of its series on: it has another zero from there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shift {
    pub(crate) series: usize,
    pub(crate) gauge: usize,
    /// Index of the first window that is shifted.
    pub(crate) window: usize,
}

impl Choice {
    /// Every reading, nothing besides the springs.
    pub(crate) fn all<const N: usize>(campaign: &Campaign<N>) -> Self {
        Self {
            weights: campaign.windows.iter().map(|window| vec![1.0; window.readings_m.len()]).collect(),
            shifts: Vec::new(),
            is_crossed: vec![false; campaign.windows.len()],
            beyond: Beyond::Play,
            hysteresis: Vec::new(),
            has_drift: false,
            held: None,
        }
    }

    /// The same unknowns with every reading again, nothing shifted; the windows `inside` a crossing take no part.
    pub(crate) fn anew<const N: usize>(&self, campaign: &Campaign<N>, inside: &[usize]) -> Self {
        let Self { weights, .. } = Self::all(campaign);
        let mut choice = Self { weights, shifts: Vec::new(), ..self.clone() };
        for window in inside {
            choice.weights[*window].fill(0.0);
            // A threshold may have had only this window beyond it.
            choice.is_crossed[*window] = false;
        }
        choice
    }

    /// No reading.
    pub(crate) fn none<const N: usize>(campaign: &Campaign<N>) -> Self {
        let mut choice = Self::all(campaign);
        choice.weights.iter_mut().flatten().for_each(|weight| *weight = 0.0);
        choice
    }

    /// Adds all readings of some windows, by index.
    pub(crate) fn use_windows(&mut self, windows: &[usize]) {
        for window in windows {
            self.weights[*window].fill(1.0);
        }
    }

    /// True if the play is fitted.
    pub(crate) fn has_play(&self) -> bool {
        self.is_crossed.contains(&true)
    }

    /// Unknowns of the links beyond the jump, besides the play.
    pub(crate) fn of_links(&self) -> usize {
        if self.has_play() { self.beyond.unknowns() } else { 0 }
    }

    /// Unknowns of the fit besides the springs: the play, the links beyond the jump, the hysteresis of gauges.
    pub(crate) fn besides_springs(&self) -> usize {
        usize::from(self.has_play()) + self.of_links() + self.hysteresis.len()
    }
}
