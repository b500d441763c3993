//! Report of a material test.

use std::fmt;

use serde::Serialize;

use crate::base::report::plot::{Axis, Marker, Plot, Series};
use crate::base::report::table::{Cell, Table};
use crate::mechanics::tissue::viscoelastic::point::{Control, Loading, Response};

/// Response of a material, as `insonify material --json` prints it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Times of the history, s.
    pub time_s: Vec<f64>,
    /// Shear strain at those times.
    pub strain: Vec<f64>,
    /// Shear stress, kPa. `None` (`null`) where it is infinite: at a jump of strain, in a spring-pot.
    pub stress_kpa: Vec<Option<f64>>,
    /// Prescribed quantity.
    #[serde(skip)]
    pub control: Control,
    /// Number of substeps between two times.
    #[serde(skip)]
    pub substeps: usize,
    /// Relative change of the response when the steps were last halved, as a fraction of its largest value; `None` if
    /// they were not.
    #[serde(skip)]
    pub change: Option<f64>,
}

/// Estimated error above which a warning is given.
const ROUGH: f64 = 1e-3;
/// Maximum number of plot points drawn with markers.
const MARKED: usize = 60;

impl Report {
    pub(super) fn new(loading: &Loading, response: Response) -> Report {
        Report {
            time_s: loading.time_s.clone(),
            strain: response.strain,
            stress_kpa: response.stress_kpa,
            control: loading.control,
            substeps: response.substeps,
            change: response.change,
        }
    }

    /// Warnings about the response.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.stress_kpa.contains(&None) {
            warnings.push("the stress at the start is infinite (null in JSON): a spring-pot cannot jump".to_owned());
        }
        match self.change {
            None => warnings.push("the history is too long to be refined: its own times are the steps".to_owned()),
            Some(change) if change > ROUGH => warnings.push(format!(
                "the answer still changed by {change:.1e} of its largest value when steps were last halved; another rule may do better"
            )),
            Some(_) => {}
        }
        warnings
    }

    /// Plot of the computed quantity against time.
    pub fn plot(&self) -> Plot {
        let pairs = |values: &mut dyn Iterator<Item = Option<f64>>| {
            let pairs = self.time_s.iter().zip(values);
            pairs.filter_map(|(time, value)| Some([*time, value?])).collect()
        };
        let (title, label, points) = match self.control {
            Control::Stress => {
                let points = pairs(&mut self.strain.iter().copied().map(Some));
                ("Strain under the given stress", "shear strain", points)
            }
            Control::Strain => {
                let points = pairs(&mut self.stress_kpa.iter().copied());
                ("Stress under the given strain", "shear stress, kPa", points)
            }
        };
        let mut series = Series::line(label, 0, points);
        if self.time_s.len() <= MARKED {
            series.marker = Marker::Disc;
        }
        Plot::new(title, Axis::linear("time, s"), Axis::linear(label), vec![series])
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = self.time_s.iter().zip(&self.strain).zip(&self.stress_kpa);
        let rows = rows.map(|((time, strain), stress)| {
            let stress = stress.map_or("infinite".to_owned(), |stress| format!("{stress:.6}"));
            [format!("{time:.6}"), format!("{strain:.6}"), stress]
        });
        let head = ["time s", "strain", "stress kPa"].map(Cell::number);
        f.write_str(&Table::new(head).with(rows).text(" ", &[14; 3]))?;
        write!(f, "\nsteps between two times {}", self.substeps)?;
        match self.change {
            Some(change) => write!(
                f,
                ", last halving changed the answer by {change:.1e} of its largest value"
            ),
            None => Ok(()),
        }
    }
}
