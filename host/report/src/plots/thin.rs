//! Fewer points for the same picture.

use crate::svg::Point;

/// Largest number of points of a run.
const KEPT: usize = 4;

/// Keeps, of each run of points within one column of px, the first, the highest, the lowest and the
/// last, in their order: what is drawn has the same extent in every column.
pub(super) fn thinned(points: &[Point]) -> Vec<Point> {
    let runs = points.chunk_by(|one, next| column(one) == column(next));
    runs.flat_map(representatives).collect()
}

fn column(point: &Point) -> i64 {
    point.x.floor() as i64
}

fn representatives(run: &[Point]) -> Vec<Point> {
    if run.len() <= KEPT {
        return run.to_vec();
    }
    let mut numbered = run.iter().enumerate();
    let kept = [
        numbered
            .clone()
            .min_by(|(_, one), (_, other)| one.y.total_cmp(&other.y)),
        numbered
            .clone()
            .max_by(|(_, one), (_, other)| one.y.total_cmp(&other.y)),
        numbered.next(),
        numbered.next_back(),
    ];
    let mut kept: Vec<(usize, &Point)> = kept.into_iter().flatten().collect();
    kept.sort_by_key(|(number, _)| *number);
    kept.dedup_by_key(|(number, _)| *number);
    kept.into_iter().map(|(_, point)| *point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Column of a run, its extent, and the heights of its ends.
    fn extent(run: &[Point]) -> (i64, [f64; 4]) {
        let heights = run.iter().map(|point| point.y);
        let (low, high) = (heights.clone().reduce(f64::min), heights.reduce(f64::max));
        let [first, last] = [run[0], run[run.len() - 1]];
        (
            column(&first),
            [low.unwrap(), high.unwrap(), first.y, last.y],
        )
    }

    fn extents(points: &[Point]) -> Vec<(i64, [f64; 4])> {
        let runs = points.chunk_by(|one, next| column(one) == column(next));
        runs.map(extent).collect()
    }

    #[test]
    fn every_column_keeps_its_extent_and_its_ends() {
        let points: Vec<Point> = (0..10_000)
            .map(|tick| {
                let tick = f64::from(tick);
                Point::new(tick / 12.5, (tick * 0.37).sin() * (tick * 0.011).cos())
            })
            .collect();
        let thinned = thinned(&points);
        assert!(thinned.len() <= KEPT * 800, "{}", thinned.len());
        assert_eq!(extents(&thinned), extents(&points));
    }
}
