use super::*;
use nalgebra::{Matrix3, Vector3};

/// Singular values of the weighted differences of the inverse kinematics, by eigenvalues of the
/// product: an independent computation.
#[test]
fn the_condition_number_is_that_of_the_inverse_kinematics() {
    let file = RobotFile::builtin_l2().unwrap();
    let survey = survey(&file, Grid::of(&file, 8), |_| {});
    let mut compared = 0;
    for place in &survey.places {
        let Ok(reached) = place.reached else { continue };
        let step = 1e-6;
        let columns: Option<Vec<_>> = (0..3)
            .map(|axis| {
                let mut away = Vector3::zeros();
                away[axis] = step;
                let ahead = file.model.axes_at(&(place.tool_m + away)).ok()?;
                let back = file.model.axes_at(&(place.tool_m - away)).ok()?;
                Some((Vector3::from(ahead) - Vector3::from(back)) / (2.0 * step))
            })
            .collect();
        let Some(columns) = columns else {
            continue;
        };
        let inverse = Matrix3::from_columns(&columns);
        let squares = (inverse * inverse.transpose()).symmetric_eigenvalues();
        let expected = (squares.max() / squares.min()).sqrt();
        // Differences leave 1e-4 of slopes that bend near a singularity; squaring loses small
        // values there as well.
        if expected < 100.0 {
            assert!(
                (reached.condition / expected - 1.0).abs() < 1e-3,
                "{place:?}"
            );
            compared += 1;
        }
    }
    assert!(compared > 10, "{compared} places");
}

/// A force along each direction of a sphere moves the tool by no more than the compliance, and by
/// as much in one of them.
#[test]
fn the_compliance_is_the_largest_over_all_directions() {
    let file = RobotFile::builtin_f1().unwrap();
    let home = file.home_m();
    let q = file.model.axes_at(&home).unwrap();
    let matrix = (file.model.lines(&home, &q).unwrap())
        .compliance(file.compliances.as_ref().unwrap())
        .unwrap()
        .translation();
    let mut largest: f64 = 0.0;
    for polar in 0..180 {
        for around in 0..360 {
            let (polar, around) = (
                f64::from(polar).to_radians(),
                f64::from(around).to_radians(),
            );
            let direction = Vector3::new(
                polar.sin() * around.cos(),
                polar.sin() * around.sin(),
                polar.cos(),
            );
            largest = largest.max((matrix * direction).norm());
        }
    }
    let found = Surveyor::new(&file).survey(home).reached.unwrap();
    let found = found.compliance_m_per_n.unwrap();
    // A degree beside the best direction costs 1 - cos(1 degree).
    assert!(
        (0.0..3e-4).contains(&(found / largest - 1.0)),
        "{found:e} {largest:e}"
    );
}

/// Places that count as reached are within the travel; places just outside of the box are not
/// reached.
#[test]
fn the_box_holds_the_whole_workspace() {
    fn check<K: MachineKind<N>, const N: usize>(file: &RobotFile<K, N>) {
        let grid = Grid::of(file, 12);
        let survey = survey(file, grid, |_| {});
        let summary = survey.summary();
        assert_eq!(u64::try_from(summary.places).unwrap(), grid.count());
        let refused: usize = summary.refused.values().sum();
        assert_eq!(summary.reached + refused, summary.places);
        assert!(summary.reached > 20, "{summary}");
        assert!(summary.home.0.is_finite(), "{summary}");
        let travel = file.model.geometry().travel.unwrap();
        for reached in survey.places.iter().filter_map(|place| place.reached.ok()) {
            for (q, (lower, upper)) in reached.q.iter().zip(travel) {
                assert!((lower..=upper).contains(q), "{reached:?}");
            }
            assert!(reached.condition >= 1.0);
        }
        // One step beyond the box, on all of its sides.
        let surveyor = Surveyor::new(file);
        for axis in 0..3 {
            let [lower, upper] =
                [grid.below, grid.above].map(|ends| i32::try_from(ends[axis]).unwrap());
            for mut steps in grid.places() {
                for end in [-lower - 1, upper + 1] {
                    steps[axis] = end;
                    let place = surveyor.survey(grid.at(steps));
                    assert!(place.reached.is_err(), "{place:?}");
                }
            }
        }
    }
    check(&RobotFile::builtin_l2().unwrap());
    check(&RobotFile::builtin_f1().unwrap());
}
