//! Comparison of groups of people by their metrics: Welch's t test and the Mann-Whitney U test, two-sided, with the
//! correction of Holm.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

use super::{COUNT, NAMES, UNITS};
use insonify::Error;
use insonify_base::csv::Csv;
use insonify_base::statistics::{mean, std};

/// Largest group for which the distribution of U is exact.
const EXACT: usize = 20;
/// Significance of a metric in the counts of the report.
pub(crate) const SIGNIFICANT: f64 = 0.05;

/// A session of a person.
#[derive(Clone, Debug, PartialEq)]
pub struct Session {
    /// Group of the person.
    pub group: String,
    /// Name of the person.
    pub person: String,
    /// Name of the session.
    pub session: String,
    /// Values of the metrics.
    pub values: [f64; COUNT],
}

/// Reads sessions from a table with the columns `group`, `person`, `session` and `m1` to `m10`.
///
/// # Errors
/// [`CsvError`](insonify_base::csv::CsvError).
pub fn read(path: &Path) -> Result<Vec<Session>, Error> {
    let required: Vec<&str> = ["group", "person", "session"].into_iter().chain(NAMES).collect();
    let table = Csv::read(path, &required, &[])?;
    let session = |row: insonify_base::csv::Row<'_>| {
        let name = |column: &str| match row.text(column) {
            "" => Err(row.wrong(column, "a name")),
            text => Ok(text.to_owned()),
        };
        Ok(Session {
            group: name("group")?,
            person: name("person")?,
            session: name("session")?,
            values: row.numbers(NAMES)?,
        })
    };
    table.rows().map(session).collect()
}

/// Distribution of a metric in a group.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean, in the unit of the metric.
    pub mean: f64,
    /// Standard deviation of the sample; `None` for a single value.
    pub sd: Option<f64>,
    /// Median, in the unit of the metric.
    pub median: f64,
    /// Values, ascending.
    #[serde(skip)]
    pub values: Vec<f64>,
}

/// Group of people, with the distribution of each metric.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// Name of the group.
    pub name: String,
    /// Number of people.
    pub people: usize,
    /// Number of sessions.
    pub sessions: usize,
    /// Distribution of each metric over sessions.
    pub metrics: BTreeMap<&'static str, Spread>,
}

/// Tests of the difference of one metric between two groups; `None` where a group has fewer than two values or none
/// vary.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// First group.
    pub a: String,
    /// Second group.
    pub b: String,
    /// Name of the metric, `m1` to `m10`.
    pub metric: &'static str,
    /// Two-sided p of Welch's t test over sessions.
    pub welch_p: Option<f64>,
    /// Two-sided p of the Mann-Whitney U test over sessions.
    pub mann_whitney_p: Option<f64>,
    /// `welch_p` corrected for the ten metrics (S. Holm, Scandinavian Journal of Statistics 6, 1979).
    pub holm_p: Option<f64>,
    /// Two-sided p of Welch's t test over the means of people, whose sessions are not independent.
    pub person_welch_p: Option<f64>,
    /// Two-sided p of the Mann-Whitney U test over the means of people.
    pub person_mann_whitney_p: Option<f64>,
}

/// Comparison of all groups with each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Groups in the order of their first sessions.
    pub groups: Vec<Group>,
    /// Tests of each pair of groups and each metric.
    pub pairs: Vec<Pair>,
    /// Units of the metrics.
    pub units: BTreeMap<&'static str, &'static str>,
}

/// Compares the groups.
pub fn compare(sessions: &[Session]) -> Comparison {
    let mut names: Vec<&str> = Vec::new();
    for session in sessions {
        if !names.contains(&session.group.as_str()) {
            names.push(&session.group);
        }
    }
    let sessions_of = |group: &str, metric: usize| -> Vec<f64> {
        let in_group = sessions.iter().filter(|session| session.group == group);
        in_group.map(|session| session.values[metric]).collect()
    };
    let people = |group: &str, metric: usize| -> Vec<f64> {
        let mut values: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for session in sessions.iter().filter(|session| session.group == group) {
            values.entry(&session.person).or_default().push(session.values[metric]);
        }
        values.values().map(|values| mean(values)).collect()
    };
    let groups = names.iter().map(|name| Group {
        name: (*name).to_owned(),
        people: people(name, 0).len(),
        sessions: sessions_of(name, 0).len(),
        metrics: (0..COUNT)
            .map(|metric| (NAMES[metric], Spread::of(sessions_of(name, metric))))
            .collect(),
    });
    let mut pairs = Vec::new();
    for (index, a) in names.iter().enumerate() {
        for b in &names[index + 1..] {
            let mut tests: Vec<Pair> = (0..COUNT)
                .map(|metric| {
                    let (x, y) = (sessions_of(a, metric), sessions_of(b, metric));
                    let (px, py) = (people(a, metric), people(b, metric));
                    Pair {
                        a: (*a).to_owned(),
                        b: (*b).to_owned(),
                        metric: NAMES[metric],
                        welch_p: welch(&x, &y),
                        mann_whitney_p: mann_whitney(&x, &y),
                        holm_p: None,
                        person_welch_p: welch(&px, &py),
                        person_mann_whitney_p: mann_whitney(&px, &py),
                    }
                })
                .collect();
            // The metrics of one pair of groups are one family of tests; another pair is another question.
            let corrected = holm(&tests.iter().map(|pair| pair.welch_p).collect::<Vec<_>>());
            tests.iter_mut().zip(corrected).for_each(|(pair, p)| pair.holm_p = p);
            pairs.extend(tests);
        }
    }
    Comparison {
        groups: groups.collect(),
        pairs,
        units: NAMES.into_iter().zip(UNITS).collect(),
    }
}

impl Spread {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self {
            mean: mean(&values),
            sd: (values.len() > 1).then(|| std(&values)),
            median: quantile(&values, 0.5),
            values,
        }
    }
}

/// Quantile of ascending values, interpolated linearly.
pub(super) fn quantile(ascending: &[f64], share: f64) -> f64 {
    let position = share * (ascending.len() as f64 - 1.0);
    let low = position.floor() as usize;
    let high = (low + 1).min(ascending.len() - 1);
    ascending[low] + (position - low as f64) * (ascending[high] - ascending[low])
}

/// Two-sided p of Welch's t test (B. L. Welch, Biometrika 34, 1947); `None` for fewer than two values, or if none vary.
pub(crate) fn welch(a: &[f64], b: &[f64]) -> Option<f64> {
    if a.len() < 2 || b.len() < 2 {
        return None;
    }
    let error = |values: &[f64]| std(values).powi(2) / values.len() as f64;
    let (ea, eb) = (error(a), error(b));
    let freedom = (ea + eb).powi(2) / (ea * ea / (a.len() as f64 - 1.0) + eb * eb / (b.len() as f64 - 1.0));
    let t = (mean(a) - mean(b)).abs() / (ea + eb).sqrt();
    let distribution = StudentsT::new(0.0, 1.0, freedom).ok()?;
    t.is_finite().then(|| 2.0 * distribution.sf(t))
}

/// Two-sided p of the Mann-Whitney U test: exact for groups of up to 20 without ties, else by the normal approximation
/// with corrections for ties and continuity; `None` for an empty group, or if none vary.
pub(crate) fn mann_whitney(a: &[f64], b: &[f64]) -> Option<f64> {
    let (n, m) = (a.len(), b.len());
    if n == 0 || m == 0 {
        return None;
    }
    let mut values: Vec<(f64, bool)> = a
        .iter()
        .map(|&x| (x, true))
        .chain(b.iter().map(|&x| (x, false)))
        .collect();
    values.sort_by(|x, y| x.0.total_cmp(&y.0));
    let (mut ranks, mut ties) = (0.0, 0.0);
    let mut start = 0;
    // Tied values share the mean of their ranks.
    while start < values.len() {
        let end = start
            + values[start..]
                .iter()
                .take_while(|pair| pair.0 == values[start].0)
                .count();
        let (count, rank) = ((end - start) as f64, (start + end + 1) as f64 / 2.0);
        ranks += rank * values[start..end].iter().filter(|pair| pair.1).count() as f64;
        ties += count.powi(3) - count;
        start = end;
    }
    let (nf, mf) = (n as f64, m as f64);
    let u = ranks - nf * (nf + 1.0) / 2.0;
    let u = u.max(nf * mf - u);
    if ties == 0.0 && n <= EXACT && m <= EXACT {
        return Some((2.0 * above(u as usize, n, m)).min(1.0));
    }
    let total = nf + mf;
    let variance = nf * mf / 12.0 * (total + 1.0 - ties / (total * (total - 1.0)));
    let z = (u - nf * mf / 2.0 - 0.5) / variance.sqrt();
    z.is_finite().then(|| (2.0 * Normal::standard().sf(z)).min(1.0))
}

/// Probability that U is at least `u`, by counting the arrangements of the ranks (H. B. Mann and D. R. Whitney, Annals
/// of Mathematical Statistics 18, 1947).
fn above(u: usize, n: usize, m: usize) -> f64 {
    // Number of ways to choose each rank sum, item by item: count[chosen][u].
    let largest = n * m;
    let mut counts = vec![vec![0.0; largest + 1]; n + 1];
    counts[0][0] = 1.0;
    for item in 0..n + m {
        for chosen in (1..=n.min(item + 1)).rev() {
            // The item precedes nothing yet: it exceeds the items of the other group before it.
            let beats = item + 1 - chosen;
            for sum in (beats..=largest).rev() {
                counts[chosen][sum] += counts[chosen - 1][sum - beats];
            }
        }
    }
    let count: f64 = counts[n].iter().sum();
    counts[n][u..].iter().sum::<f64>() / count
}

/// Corrects p values for their number by the method of Holm; missing values stay missing.
pub(crate) fn holm(p: &[Option<f64>]) -> Vec<Option<f64>> {
    let mut order: Vec<(usize, f64)> = p
        .iter()
        .enumerate()
        .filter_map(|(index, p)| Some((index, (*p)?)))
        .collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut corrected = vec![None; p.len()];
    let (count, mut least) = (order.len(), 0.0_f64);
    for (rank, (index, p)) in order.into_iter().enumerate() {
        least = least.max((p * (count - rank) as f64).min(1.0));
        corrected[index] = Some(least);
    }
    corrected
}
