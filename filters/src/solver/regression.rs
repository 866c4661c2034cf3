//! Columns of data as sums of others, by least squares, and an order in which the others come first.
//!
//! Source: G. Golub, C. Van Loan, "Matrix Computations", 4th edition, 2013, section 5.3.

use super::cholesky::Cholesky;

/// Largest sum of the sizes of the factors of columns in units of their ranges: errors of those columns add up by it.
const LARGEST: f64 = 1.5;
/// Largest value of a column over its range: its values are rounded, and its factor multiplies that.
const FARTHEST: f64 = 100.0;
/// Values that are looked at, at most, evenly taken.
const VALUES: usize = 1 << 16;
/// Share of the variance that may be left where it pays.
const PAYS: f64 = 0.5;
/// A column of which those before leave less than this share of the variance is no help.
const ALIKE: f64 = 1e-6;

/// A constant and factors of other columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What is added.
    pub constant: f64,
    /// Numbers of columns, and what these are multiplied by.
    pub factors: Vec<(usize, f64)>,
}

/// A column: some of its values, which belong to those of other columns by number, and the range of all.
#[derive(Clone, Debug)]
pub struct Column {
    values: Vec<f32>,
    /// The largest of all values less the smallest.
    pub range: f64,
}

impl Column {
    /// Takes so many values of this range.
    pub fn new(values: impl Iterator<Item = f32>, count: usize, range: f64) -> Self {
        Self { values: values.step_by(count.div_ceil(VALUES).max(1)).collect(), range }
    }
}

/// In which order to take columns; those with a range of zero are left out. With each, what those before it explain, where that
/// pays.
pub fn order(columns: &[Column]) -> Vec<(usize, Option<Line>)> {
    let mut open: Vec<usize> = (0..columns.len()).filter(|&k| columns[k].range > 0.0).collect();
    let moments = Moments::new(columns);
    let near = |k: usize| {
        let Column { values, range } = &columns[k];
        values.iter().all(|value| f64::from(value.abs()) <= FARTHEST * range)
    };
    let near: Vec<bool> = (0..columns.len()).map(near).collect();
    let mut order = Vec::new();
    // From the last one on: that of which the others leave least.
    while open.len() > 1 {
        let explain = |(index, &k): (usize, &usize)| {
            let others: Vec<usize> = open.iter().copied().filter(|&j| j != k && near[j]).collect();
            moments.explain(&others, k).map(|(left, line)| (left, index, line))
        };
        let least = open.iter().enumerate().filter_map(explain).reduce(|a, b| if b.0 <= a.0 { b } else { a });
        let Some((_, index, line)) = least else { break };
        order.push((open.remove(index), Some(line)));
    }
    order.extend(open.into_iter().rev().map(|k| (k, None)));
    order.reverse();
    order
}

/// Means of columns and products of their differences from these, in units of their ranges.
struct Moments {
    ranges: Vec<f64>,
    means: Vec<f64>,
    products: Vec<Vec<f64>>,
}

impl Moments {
    fn new(columns: &[Column]) -> Self {
        let n = columns.len();
        let units = |k: usize| {
            let Column { values, range } = &columns[k];
            values.iter().map(move |&value| if *range > 0.0 { f64::from(value) / range } else { 0.0 })
        };
        let mean = |k: usize| units(k).sum::<f64>() / columns[k].values.len().max(1) as f64;
        let means: Vec<f64> = (0..n).map(mean).collect();
        let mut products = vec![vec![0.0; n]; n];
        for i in 0..n {
            for j in 0..=i {
                let terms = units(i).zip(units(j)).map(|(a, b)| (a - means[i]) * (b - means[j]));
                products[i][j] = terms.sum();
                products[j][i] = products[i][j];
            }
        }
        Self { ranges: columns.iter().map(|column| column.range).collect(), means, products }
    }

    /// The share of the variance of column `k` that others leave, and how they explain the rest; `None` if that does not pay.
    fn explain(&self, others: &[usize], k: usize) -> Option<(f64, Line)> {
        let factor = Cholesky::new(others.len(), ALIKE, |i, j| self.products[others[i]][others[j]]);
        let shared: Vec<f64> = others.iter().map(|&j| self.products[j][k]).collect();
        let mut factors = shared.clone();
        factor.solve(&mut factors);
        let whole = self.products[k][k];
        let explained: f64 = factors.iter().zip(&shared).map(|(factor, shared)| factor * shared).sum();
        let left = (whole - explained).max(0.0) / whole;
        let size: f64 = factors.iter().map(|factor| factor.abs()).sum();
        if !(whole > 0.0 && left <= PAYS && size <= LARGEST) {
            return None;
        }
        let mean = |k: usize| self.means[k] * self.ranges[k];
        let used = others.iter().zip(factors).filter(|factor| factor.1 != 0.0);
        let factors: Vec<(usize, f64)> =
            used.map(|(&j, a)| (j, a * self.ranges[k] / self.ranges[j])).collect();
        let constant = mean(k) - factors.iter().map(|&(j, a)| a * mean(j)).sum::<f64>();
        Some((left, Line { constant, factors }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize, seed: usize) -> f32 {
        ((k * 7919 + seed * 104_729 + 17) % 1009) as f32 / 1009.0
    }

    fn column(value: impl Fn(usize) -> f32) -> Column {
        let values: Vec<f32> = (0..500).map(value).collect();
        let (low, high) =
            values.iter().fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
        Column::new(values.into_iter(), 500, f64::from(high - low))
    }

    /// A mixture of two columns is found whichever place it has; it comes last, and is what the line says.
    #[test]
    fn a_mixture_is_explained_by_its_parts() {
        let (a, b) = (|k: usize| 3.0 + noise(k, 1), |k: usize| 1e3 * noise(k, 2));
        let mixture = move |k: usize| -7.0 + 0.4 * a(k) + 5e-4 * b(k);
        for place in 0..3 {
            let mut columns = vec![column(a), column(b)];
            columns.insert(place, column(mixture));
            let order = order(&columns);
            assert_eq!(order.len(), 3);
            assert!(order[0].1.is_none() && order[1].1.is_none(), "{order:?}");
            assert_eq!(order[2].0, place);
            let line = order[2].1.as_ref().unwrap();
            for k in 0..500 {
                let terms = line.factors.iter().map(|&(j, factor)| factor * f64::from(columns[j].values[k]));
                let value = line.constant + terms.sum::<f64>();
                assert!(
                    (value - f64::from(mixture(k))).abs() <= 64.0 * f64::from(f32::EPSILON) * 7.0,
                    "{value}"
                );
            }
        }
    }

    /// What has nothing in common, or is constant, is left alone, as is what others explain by large factors only.
    #[test]
    fn what_does_not_pay_is_not_explained() {
        let columns =
            [column(|k| noise(k, 1)), column(|_| 2.0), column(|k| noise(k, 2)), column(|k| noise(k, 3))];
        assert_eq!(order(&columns), vec![(0, None), (2, None), (3, None)]);
        // Of `b`, `a + b / 100` and `a`, each of the latter explains the other; for the third it takes factors of 100.
        let (a, b) = (|k: usize| noise(k, 1), |k: usize| noise(k, 2));
        let columns = [column(b), column(move |k| a(k) + b(k) / 100.0), column(a)];
        let order = order(&columns);
        assert_eq!(order.iter().filter(|column| column.1.is_some()).count(), 1, "{order:?}");
        assert!(
            order.iter().flat_map(|column| &column.1).flat_map(|line| &line.factors).all(|f| f.1.abs() < 1.2)
        );
    }

    /// Of two copies each explains the other, and a third column needs but one.
    #[test]
    fn a_copy_is_of_no_more_use() {
        let (a, b) = (|k: usize| noise(k, 1), |k: usize| noise(k, 2));
        let columns = [column(a), column(a), column(move |k| a(k) + 0.1 * b(k))];
        let order = order(&columns);
        let lines: Vec<&Line> = order.iter().filter_map(|column| column.1.as_ref()).collect();
        assert_eq!(lines.len(), 2, "{order:?}");
        for line in lines {
            assert_eq!(line.factors.iter().filter(|factor| factor.1.abs() > 1e-9).count(), 1, "{order:?}");
        }
    }

    /// Values far from zero are rounded so that what they explain would be rounded, too.
    #[test]
    fn a_column_far_from_zero_explains_nothing() {
        let columns = [column(|k| 1000.0 + noise(k, 1)), column(|k| noise(k, 1))];
        let order = order(&columns);
        let explained: Vec<usize> =
            order.iter().filter(|column| column.1.is_some()).map(|column| column.0).collect();
        assert_eq!(explained, [0]);
    }

    #[test]
    fn many_values_are_taken_evenly() {
        let column = Column::new((0..200_000).map(|k| k as f32), 200_000, 2e5);
        assert!(column.values.len() <= VALUES && column.values.len() > VALUES / 2);
        assert_eq!(column.values[1] - column.values[0], column.values[9] - column.values[8]);
    }

    #[test]
    fn nothing_makes_an_empty_order() {
        assert!(order(&[]).is_empty());
        assert!(order(&[Column::new(std::iter::empty(), 0, 0.0)]).is_empty());
    }
}
