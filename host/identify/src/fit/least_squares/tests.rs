use super::*;
use std::convert::Infallible;

/// Rows of `y = a exp(b x)`, measured without error at ten places.
fn exponential(truth: [f64; 2], at: &[f64; 2]) -> Rows {
    fn predicted([a, b]: [f64; 2], x: f64) -> f64 {
        a * (b * x).exp()
    }
    let places = (0..10_u8).map(f64::from);
    let residuals = places
        .clone()
        .map(|x| (predicted(truth, x) - predicted(*at, x)) / 0.01);
    let derivatives = places
        .flat_map(|x| [(at[1] * x).exp(), at[0] * x * (at[1] * x).exp()])
        .map(|d| d / 0.01);
    let residuals = DVector::from_iterator(10, residuals);
    Rows::new(residuals, DMatrix::from_row_iterator(10, 2, derivatives))
}

#[test]
fn a_pivot_is_small_beside_the_largest() {
    assert_eq!(
        [[1e6, 1e-9], [1e6, -1e-3], [1e-6, 1e-9]]
            .map(|pivots| rank(&DMatrix::from_diagonal(&DVector::from_row_slice(&pivots)))),
        [1, 2, 2]
    );
    assert_eq!(
        rank(&DMatrix::from_row_slice(1, 3, &[2.0, 1.0, 1.0])),
        1,
        "of fewer rows than columns"
    );
}

fn moved(state: &[f64; 2], step: &DVector<f64>) -> [f64; 2] {
    [state[0] + step[0], state[1] + step[1]]
}

#[test]
fn a_curve_is_found_from_far_away() {
    let truth = [2.0, -0.3];
    for start in [[1.0, 0.0], [5.0, -2.0], [0.1, 0.2]] {
        let fit = fit(
            start,
            &DVector::from_vec(vec![1.0, 1.0]),
            |state| Ok::<_, Infallible>(exponential(truth, state)),
            moved,
        )
        .unwrap();
        // The last step is shorter than 1e-6 standard deviations of 0.01.
        assert!(
            (fit.state[0] - 2.0).abs() < 1e-8 && (fit.state[1] + 0.3).abs() < 1e-8,
            "{fit:?}"
        );
        assert_eq!((fit.degrees(), fit.seen.kept()), (8, 2));
    }
}

#[test]
fn the_covariance_is_that_of_the_normal_equations() {
    let rows = exponential([2.0, -0.3], &[2.0, -0.3]);
    let seen = Observability::new(&rows, &DVector::from_vec(vec![3.0, 0.7]));
    let expected = (rows.derivatives.transpose() * &rows.derivatives)
        .try_inverse()
        .unwrap();
    assert!((seen.covariance() - &expected).amax() < 1e-12 * expected.amax());
}

#[test]
fn a_lost_direction_keeps_its_value_and_is_named() {
    fn of_a_sum(state: &[f64; 2]) -> Result<Rows, Infallible> {
        let residuals = DVector::repeat(5, (10.0 - state[0] - state[1]) / 0.1);
        Ok(Rows::new(residuals, DMatrix::repeat(5, 2, 10.0)))
    }
    let fit = fit([1.0, 3.0], &DVector::repeat(2, 1.0), of_a_sum, moved).unwrap();
    assert!(
        (fit.state[0] - 4.0).abs() < 1e-12 && (fit.state[1] - 6.0).abs() < 1e-12,
        "the difference stays"
    );
    let lost = Observability::new(&fit.rows, &DVector::repeat(2, 1.0)).lost();
    assert_eq!((lost.len(), fit.degrees()), (1, 4));
    assert!((lost[0].components[0] + lost[0].components[1]).abs() < 1e-12);
    assert!(fit.held.kept().is_empty() && fit.held.count() == 1);
}

/// Rows of a line of this slope, whose offset is a nuisance parameter.
fn line_with_offset(slope: &f64) -> Result<Rows, Infallible> {
    let measured = [0.3, 1.1, 2.4, 2.9, 4.2];
    let residuals = DVector::from_iterator(
        5,
        (0..5_u8)
            .zip(measured)
            .map(|(x, y)| y - slope * f64::from(x)),
    );
    let rows = Rows::new(
        residuals,
        DMatrix::from_iterator(5, 1, (0..5_u8).map(f64::from)),
    );
    Ok(rows.without(DMatrix::repeat(5, 1, 1.0)))
}

#[test]
fn a_nuisance_is_projected_out_as_if_it_had_been_estimated() {
    let fit = fit(
        0.0,
        &DVector::repeat(1, 1.0),
        line_with_offset,
        |slope, step| slope + step[0],
    )
    .unwrap();
    // Textbook: sum (x - 2) y / sum (x - 2)^2, and its variance 1 / sum (x - 2)^2.
    let expected = (-2.0 * 0.3 - 1.1 + 2.9 + 2.0 * 4.2) / 10.0;
    assert!((fit.state - expected).abs() < 1e-12);
    assert!((fit.seen.covariance()[(0, 0)] - 0.1).abs() < 1e-12);
    assert_eq!(fit.degrees(), 3);
}

fn few(_: &[f64; 2]) -> Result<Rows, Infallible> {
    Ok(Rows::new(DVector::zeros(1), DMatrix::zeros(1, 2)))
}

fn not_finite(_: &[f64; 2]) -> Result<Rows, Infallible> {
    Ok(Rows::new(
        DVector::repeat(3, f64::NAN),
        DMatrix::zeros(3, 2),
    ))
}

/// Derivatives of the wrong sign.
fn reversed(state: &[f64; 2]) -> Result<Rows, Infallible> {
    let rows = exponential([2.0, -0.3], state);
    Ok(Rows {
        derivatives: -rows.derivatives,
        ..rows
    })
}

#[test]
fn what_cannot_be_fitted_is_named() {
    let scales = DVector::repeat(2, 1.0);
    assert_eq!(
        fit([0.0; 2], &scales, few, moved).unwrap_err(),
        FitError::TooFew {
            readings: 1,
            parameters: 2
        }
    );
    assert_eq!(
        fit([0.0; 2], &scales, not_finite, moved).unwrap_err(),
        FitError::NotFinite
    );
    assert_eq!(
        fit([0.0; 2], &scales, |_| Err("no such pose"), moved).unwrap_err(),
        FitError::Start("no such pose")
    );
    // No step helps.
    assert!(matches!(
        fit([1.0, 0.0], &scales, reversed, moved),
        Err(FitError::NotConverged { .. })
    ));
}

#[test]
fn fewer_rows_than_unknowns_leave_nothing() {
    // Two readings, three zeros of which one is not read.
    let unknowns = DMatrix::from_row_slice(2, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    assert_eq!(
        eliminated(unknowns.clone(), DMatrix::from_element(2, 1, 5.0)).nrows(),
        0
    );
    let (solution, rank) = solve(unknowns, DVector::from_vec(vec![3.0, 4.0]));
    assert_eq!((solution.as_slice(), rank), (&[3.0, 4.0, 0.0][..], 2));
    // The same reading twice: one degree of freedom is left.
    let twice = DMatrix::from_row_slice(2, 3, &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert_eq!(
        eliminated(twice, DMatrix::from_element(2, 1, 5.0)).nrows(),
        1
    );
}

#[test]
fn linear_equations_have_one_solution_or_none() {
    let line = DMatrix::from_row_slice(3, 2, &[0.0, 1.0, 1.0, 1.0, 2.0, 1.0]);
    let solved = solve_linear(line.clone(), DVector::from_vec(vec![1.0, 3.0, 5.0])).unwrap();
    // 1 + 2 x, to rounding.
    assert!(
        (solved[0] - 2.0).abs() < 1e-12 && (solved[1] - 1.0).abs() < 1e-12,
        "{solved}"
    );
    for rows in 0..2 {
        assert_eq!(
            solve_linear(line.rows(0, rows).into_owned(), DVector::zeros(rows)),
            None
        );
    }
    assert_eq!(
        solve_linear(DMatrix::from_element(3, 2, 1.0), DVector::zeros(3)),
        None
    );
}
