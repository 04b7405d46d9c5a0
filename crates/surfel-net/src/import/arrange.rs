//! From the layout of a reference's tensor to ours.
//!
//! Invariant: [`run`] after a successful [`check`] gives exactly the values of our shape.

/// What has to be done.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Step {
    /// Nothing.
    Same,
    /// A matrix is stored the other way round.
    Transpose,
    /// A last dimension of one is added.
    AppendOne,
    /// These rows (first index), in this order.
    Rows(Vec<usize>),
}

/// Whether a tensor of shape `theirs` becomes one of shape `ours`; otherwise why not.
pub(super) fn check(step: &Step, theirs: &[usize], ours: &[usize]) -> Result<(), String> {
    let become_ours = match (step, theirs) {
        (Step::Same, _) => theirs == ours,
        (Step::Transpose, &[rows, columns]) => ours == [columns, rows],
        (Step::AppendOne, _) => ours.split_last().is_some_and(|(last, rest)| *last == 1 && rest == theirs),
        (Step::Rows(rows), &[count, ref rest @ ..]) => {
            let fits = ours.split_first().is_some_and(|(first, others)| *first == rows.len() && others == rest);
            fits && rows.iter().all(|row| *row < count)
        }
        _ => false,
    };
    if become_ours {
        Ok(())
    } else {
        Err(format!("has shape {theirs:?}, of which no {ours:?} can be made that this configuration needs"))
    }
}

/// The values of our tensor, row-major.
pub(super) fn run(step: &Step, theirs: &[usize], values: Vec<f32>) -> Vec<f32> {
    match (step, theirs) {
        (Step::Transpose, &[rows, columns]) => (0..columns)
            .flat_map(|column| (0..rows).map(move |row| (row, column)))
            .map(|(row, column)| values[row * columns + column])
            .collect(),
        (Step::Rows(rows), &[count, ..]) => {
            let len = values.len() / count;
            rows.iter().flat_map(|row| &values[row * len..][..len]).copied().collect()
        }
        _ => values,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_step_does_what_it_says() {
        let values: Vec<f32> = (0..6).map(|v| v as f32).collect();
        let done = |step: &Step, theirs: &[usize], ours: &[usize]| {
            check(step, theirs, ours).map(|()| run(step, theirs, values.clone()))
        };
        assert_eq!(done(&Step::Same, &[2, 3], &[2, 3]).unwrap(), values);
        assert_eq!(done(&Step::Transpose, &[2, 3], &[3, 2]).unwrap(), [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
        assert_eq!(done(&Step::AppendOne, &[2, 3], &[2, 3, 1]).unwrap(), values);
        assert_eq!(done(&Step::Rows(vec![2, 0]), &[3, 2], &[2, 2]).unwrap(), [4.0, 5.0, 0.0, 1.0]);
        for (step, theirs, ours) in [
            (Step::Same, vec![2, 3], vec![3, 2]),
            (Step::Transpose, vec![2, 3], vec![2, 3]),
            (Step::Transpose, vec![6], vec![6]),
            (Step::AppendOne, vec![2, 3], vec![2, 3]),
            (Step::AppendOne, vec![6], vec![]),
            (Step::Rows(vec![2, 3]), vec![3, 2], vec![2, 2]),
            (Step::Rows(vec![0]), vec![3, 2], vec![1, 3]),
            (Step::Rows(vec![0]), vec![], vec![1]),
        ] {
            let why = check(&step, &theirs, &ours).unwrap_err();
            assert!(why.contains(&format!("{theirs:?}")), "{why}");
        }
    }
}
