//! Links beyond the jump: longer by the play of their joint, or each on a line of its own.
//!
//! The line of a link is `c f` before the jump and `o + (c + d) f` beyond it: the *offset* `o` is
//! what it jumps by, `c + d` its compliance there. The play is the offset that links 31, 32 and 33
//! have in common; five more make six. This is how the thesis read its figures 5.7 and 5.8.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::LINKS;
use nalgebra::{DMatrix, DVector, Vector6};

/// First link of cluster 3 in link order.
pub(super) const CLUSTER_3: usize = 3;
/// Offsets without the play: of the links 11, 21, 22, 31 and 32; with the play that of link 33 too.
const OFFSETS: usize = LINKS - 1;

/// Parameters of the links beyond the jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PostJumpModel {
    /// The play.
    Play,
    /// An offset of each link.
    Offsets,
    /// An offset, and a change of the compliance, of each link.
    Lines,
}

impl PostJumpModel {
    /// Unknowns, the play not counted: offsets, m, then changes of compliances, m/N.
    pub(super) const fn unknowns(self) -> usize {
        match self {
            Self::Play => 0,
            Self::Offsets => OFFSETS,
            Self::Lines => OFFSETS + LINKS,
        }
    }

    /// Changes of the unknowns that would matter: `offset_m` of an offset, the file's `links` of a
    /// compliance.
    pub(super) fn scales(self, offset_m: f64, links: &[f64]) -> Vec<f64> {
        let all = std::iter::repeat_n(offset_m, OFFSETS).chain(links.iter().take(LINKS).copied());
        all.take(self.unknowns()).collect()
    }

    /// Derivatives by the unknowns, where those by the length of each link, and by its compliance,
    /// are known.
    pub(super) fn columns(self, lengths: &DMatrix<f64>, springs: &DMatrix<f64>) -> DMatrix<f64> {
        let mut all = DMatrix::zeros(lengths.nrows(), OFFSETS + LINKS);
        all.columns_mut(0, OFFSETS)
            .copy_from(&lengths.columns(0, OFFSETS));
        all.columns_mut(OFFSETS, LINKS)
            .copy_from(&springs.columns(0, LINKS));
        all.columns(0, self.unknowns()).into_owned()
    }
}

/// Index of the change of the first link's compliance among the unknowns.
pub(super) const CHANGES: usize = OFFSETS;

/// Geometry beyond the jump, where links are longer by the play and their unknowns: another length,
/// and nothing else. `tensions_n`: what the links carry; it depends on the load alone, and hardly
/// on how much they give.
pub(super) fn longer(
    geometry: &f1::Geometry,
    play_m: f64,
    unknowns: &DVector<f64>,
    tensions_n: &Vector6<f64>,
) -> f1::Geometry {
    let mut longer = *geometry;
    for (link, length) in longer.lengths_m.iter_mut().enumerate() {
        let play = if link >= CLUSTER_3 { play_m } else { 0.0 };
        let offset = if link < OFFSETS {
            unknowns.get(link).copied().unwrap_or(0.0)
        } else {
            0.0
        };
        let change = unknowns.get(CHANGES + link).copied().unwrap_or(0.0);
        *length += play + offset + change * tensions_n[link];
    }
    longer
}
