//! Mistakes with the columns of a wrench: signs, units, order, axes.
#![expect(
    clippy::indexing_slicing,
    reason = "six columns and three axes are counted by the arrays themselves"
)]

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Newtons of a kilogram's weight.
const NEWTONS_PER_KG: f64 = 9.806_65;
/// Forces, moments and all of the wrench.
const FORCES: [usize; 3] = [0, 1, 2];
const MOMENTS: [usize; 3] = [3, 4, 5];
pub(crate) const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];
/// Sentence for two columns in the place of each other.
pub(crate) const SWAPPED: &str = "these two columns are swapped";

/// Columns of a wrench that are not what their names say.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MistakenColumns {
    pub(crate) columns: Vec<usize>,
    /// The wrench is this matrix times that of the table.
    pub(crate) mended: Matrix6<f64>,
    /// The sentence for it.
    pub(crate) reason: String,
}

impl MistakenColumns {
    /// All that a table can show by itself, the simplest first; `names`: those of its six columns.
    pub(crate) fn all(names: [&'static str; 6]) -> impl Iterator<Item = Self> {
        let groups = [
            Self::scaled(
                &FORCES,
                -1.0,
                "the forces have the wrong sign; negate these columns",
            ),
            Self::scaled(
                &MOMENTS,
                -1.0,
                "the moments have the wrong sign; negate these columns",
            ),
            Self::scaled(
                &FORCES,
                NEWTONS_PER_KG,
                "the forces are in kg; write newtons: 9.80665 times as much",
            ),
            Self::scaled(&FORCES, 1e3, "the forces are in kN; write newtons"),
            Self::scaled(&MOMENTS, 1e-3, "the moments are in N mm; write N m"),
        ];
        let single = ALL.map(|column| {
            Self::scaled(&[column], -1.0, "this column has the wrong sign; negate it")
        });
        groups.into_iter().chain(single).chain(orders(names))
    }

    /// Columns that must be multiplied.
    pub(crate) fn scaled(columns: &[usize], factor: f64, reason: &str) -> Self {
        let factors = Vector6::from_fn(|column, _| {
            if columns.contains(&column) {
                factor
            } else {
                1.0
            }
        });
        Self {
            columns: columns.to_vec(),
            mended: Matrix6::from_diagonal(&factors),
            reason: reason.to_owned(),
        }
    }

    /// Columns in another order, or along other axes.
    fn ordered(names: &[&str; 6], forces: &Matrix3<f64>, moments: &Matrix3<f64>) -> Self {
        let mut mended = Matrix6::zeros();
        mended.fixed_view_mut::<3, 3>(0, 0).copy_from(forces);
        mended.fixed_view_mut::<3, 3>(3, 3).copy_from(moments);
        let columns: Vec<usize> = ALL
            .into_iter()
            .filter(|column| mended[(*column, *column)] < 1.0)
            .collect();
        let is_swap = columns.len() == 2 && mended.iter().all(|entry| *entry >= 0.0);
        let reason = if is_swap {
            SWAPPED.to_owned()
        } else {
            let written: Vec<String> = columns
                .iter()
                .map(|column| signed(names, &mended.row(*column).transpose()))
                .collect();
            format!(
                "the wrench is along other axes; write {} in their place",
                written.join(", ")
            )
        };
        Self {
            columns,
            mended,
            reason,
        }
    }

    /// Those of the names of the table's six columns that are mistaken.
    pub(crate) fn list(&self, names: &[&str; 6]) -> String {
        self.columns
            .iter()
            .map(|column| names[*column])
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// Orders of the columns of forces, of moments, and axes of the whole wrench, other than the right
/// ones.
fn orders(names: [&'static str; 6]) -> impl Iterator<Item = MistakenColumns> {
    let others: Vec<Matrix3<f64>> = signed_permutations()
        .into_iter()
        .filter(|matrix| *matrix != Matrix3::identity())
        .collect();
    let plain: Vec<_> = others
        .iter()
        .filter(|matrix| matrix.min() >= 0.0)
        .copied()
        .collect();
    let turned: Vec<_> = others
        .into_iter()
        .filter(|matrix| matrix.determinant() > 0.0)
        .collect();
    let swapped = plain
        .clone()
        .into_iter()
        .filter(|matrix| matrix.determinant() < 0.0);
    let one = plain
        .clone()
        .into_iter()
        .map(|matrix| [matrix, Matrix3::identity()]);
    let other = plain
        .into_iter()
        .map(|matrix| [Matrix3::identity(), matrix]);
    let both = swapped.chain(turned).map(|matrix| [matrix, matrix]);
    one.chain(other)
        .chain(both)
        .map(move |[forces, moments]| MistakenColumns::ordered(&names, &forces, &moments))
}

/// The 48 matrices that put three axes in another order, and reverse some.
fn signed_permutations() -> Vec<Matrix3<f64>> {
    let order = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let signs = (0..8_u8)
        .map(|bits| Vector3::from_fn(|axis, _| if bits >> axis & 1 == 1 { -1.0 } else { 1.0 }));
    signs
        .flat_map(|signs| {
            order.map(|order| {
                Matrix3::from_fn(|row, column| {
                    if order[row] == column {
                        signs[row]
                    } else {
                        0.0
                    }
                })
            })
        })
        .collect()
}

/// The one column that a row of a signed permutation takes, with its sign.
fn signed(names: &[&str; 6], row: &Vector6<f64>) -> String {
    let column = row.iamax();
    format!(
        "{}{}",
        if row[column] < 0.0 { "-" } else { "" },
        names[column]
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurements::springs::LOAD;

    #[test]
    fn orders_are_all_that_differ_and_axes_stay_right_handed() {
        let all: Vec<MistakenColumns> = orders(LOAD).collect();
        // Of the forces or the moments, swaps in both, and axes of the whole wrench.
        assert_eq!(all.len(), 5 + 5 + 3 + 23);
        let sentences: std::collections::HashSet<String> = all
            .iter()
            .map(|order| format!("{} {}", order.list(&LOAD), order.reason))
            .collect();
        assert_eq!(sentences.len(), all.len(), "each has its own sentence");
        for order in &all {
            let table = Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0);
            let change = order.mended * table - table;
            let changed: Vec<usize> = ALL
                .into_iter()
                .filter(|column| change[*column].abs() > 0.5)
                .collect();
            assert_eq!(order.columns, changed);
            // Two axes in the place of each other are left-handed, and no column has another sign
            // then.
            let halves =
                [0, 3].map(|first| order.mended.fixed_view::<3, 3>(first, first).determinant());
            let has_signs = order.mended.min() < 0.0;
            assert!(
                !has_signs || halves.iter().all(|half| *half > 0.0),
                "{}",
                order.mended
            );
        }
    }
}
