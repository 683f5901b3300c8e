//! Readings that a fit uses, and unknowns that it has in addition to the springs.

use super::post_jump::PostJumpModel;
use crate::fit::held_directions::HeldDirections;
use crate::measurements::springs::Campaign;

/// Readings that a fit uses, and unknowns that it has in addition to the springs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ActiveSet {
    /// Weight of each reading by window and gauge, which divides its variance; 0: it is not used.
    pub(crate) weights: Vec<Vec<f64>>,
    /// Gauges that were moved.
    pub(crate) shifts: Vec<Shift>,
    /// Windows beyond the jump. The play is fitted if there are any.
    pub(crate) is_crossed: Vec<bool>,
    /// Model of the links there.
    pub(crate) post_jump: PostJumpModel,
    /// Gauges whose half-width of the hysteresis is fitted.
    pub(crate) hysteresis: Vec<usize>,
    /// A drift of each gauge in each series is fitted.
    pub(crate) has_drift: bool,
    /// Directions that no step goes along, of the springs; `None`: those that are lost where a step
    /// begins.
    pub(crate) held: Option<HeldDirections>,
}

/// A gauge that stays shifted from a window of its series on: it has another zero from there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shift {
    pub(crate) series: usize,
    pub(crate) gauge: usize,
    /// Index of the first window that is shifted.
    pub(crate) window: usize,
}

impl ActiveSet {
    /// Every reading, and the springs alone.
    pub(crate) fn all<const N: usize>(campaign: &Campaign<N>) -> Self {
        Self {
            weights: campaign
                .windows
                .iter()
                .map(|window| vec![1.0; window.readings_m.len()])
                .collect(),
            shifts: Vec::new(),
            is_crossed: vec![false; campaign.windows.len()],
            post_jump: PostJumpModel::Play,
            hysteresis: Vec::new(),
            has_drift: false,
            held: None,
        }
    }

    /// The same unknowns with every reading again, nothing shifted; the windows `inside` a crossing
    /// take no part.
    pub(crate) fn with_all_readings_but<const N: usize>(
        &self,
        campaign: &Campaign<N>,
        inside: &[usize],
    ) -> Self {
        let Self { weights, .. } = Self::all(campaign);
        let mut active = Self {
            weights,
            shifts: Vec::new(),
            ..self.clone()
        };
        for window in inside {
            active.weights[*window].fill(0.0);
            // A threshold may have had only this window beyond it.
            active.is_crossed[*window] = false;
        }
        active
    }

    /// No reading.
    pub(crate) fn none<const N: usize>(campaign: &Campaign<N>) -> Self {
        let mut active = Self::all(campaign);
        active
            .weights
            .iter_mut()
            .flatten()
            .for_each(|weight| *weight = 0.0);
        active
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

    /// Unknowns of the links beyond the jump, the play not counted.
    pub(crate) fn link_unknowns(&self) -> usize {
        if self.has_play() {
            self.post_jump.unknowns()
        } else {
            0
        }
    }

    /// Unknowns of the fit that are not springs: the play, the links beyond the jump, the
    /// hysteresis of gauges.
    pub(crate) fn further_unknowns(&self) -> usize {
        usize::from(self.has_play()) + self.link_unknowns() + self.hysteresis.len()
    }
}
