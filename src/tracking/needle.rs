//! Needle geometry: tip, shaft, bending, and the path over time.

mod path;

pub use path::NeedlePath;

use nalgebra::{Matrix4, Point3, Unit, Vector3};

use super::error::{TrackingError, in_range};
use super::pose::unit;
use insonify_base::range::parameters;

/// Default diameter, mm: 18 gauge, a usual core biopsy needle.
pub const DEFAULT_DIAMETER_MM: f64 = 1.27;
/// Default length, mm: a usual biopsy needle.
pub const DEFAULT_LENGTH_MM: f64 = 150.0;

/// Maximum number of nodes of a shaft: one every 5 mm of a needle of 300 mm, and a few more.
pub const MAX_NODES: usize = 65;

/// Largest coordinate of a needle, mm.
const FARTHEST_MM: f64 = insonify_base::matrix::FARTHEST_MM;

/// A needle in the world (LPS, mm): a shaft as a polyline from hub to tip, and a diameter. Always finite, of positive
/// length.
#[derive(Clone, Debug, PartialEq)]
pub struct NeedlePose {
    nodes: Vec<Point3<f64>>,
    diameter_mm: f64,
}

impl NeedlePose {
    /// A straight needle from its tip, its direction (any length), the length of its shaft and its diameter, mm.
    pub fn straight(
        tip_mm: Point3<f64>,
        direction: Vector3<f64>,
        length_mm: f64,
        diameter_mm: f64,
    ) -> Result<Self, TrackingError> {
        in_range::<NeedleSpec>("needle", "length_mm", length_mm)?;
        let direction = unit("needle", "direction", direction)?;
        let tip = point("tip_mm", tip_mm.into())?;
        Self::shaft("tip_mm", vec![tip - direction.scale(length_mm), tip], diameter_mm)
    }

    /// A needle with a straight shaft from node to node, hub first and tip last, mm.
    pub fn bent(nodes_mm: Vec<Point3<f64>>, diameter_mm: f64) -> Result<Self, TrackingError> {
        Self::shaft("nodes_mm", nodes_mm, diameter_mm)
    }

    fn shaft(key: &'static str, nodes: Vec<Point3<f64>>, diameter_mm: f64) -> Result<Self, TrackingError> {
        in_range::<NeedleSpec>("needle", "diameter_mm", diameter_mm)?;
        if nodes.len() < 2 {
            let text = format!(
                "needle key `nodes_mm` holds {} points; expected at least 2, hub first",
                nodes.len()
            );
            return Err(TrackingError::at("nodes_mm", text));
        }
        if nodes.len() > MAX_NODES {
            let expected = format!("at most {MAX_NODES}, hub first: leave some out");
            let text = format!(
                "needle key `nodes_mm` holds {} points; expected {expected}",
                nodes.len()
            );
            return Err(TrackingError::at("nodes_mm", text));
        }
        for node in &nodes {
            point(key, (*node).into())?;
        }
        let too_close = |pair: &[Point3<f64>]| (pair[1] - pair[0]).norm() < 1e-9;
        match nodes.windows(2).position(too_close) {
            Some(first) => Err(coincident(first)),
            None => Ok(Self { nodes, diameter_mm }),
        }
    }

    /// Position of the tip, mm.
    pub fn tip_mm(&self) -> Point3<f64> {
        self.nodes[self.nodes.len() - 1]
    }

    /// Hub end of the shaft, mm.
    pub fn hub_mm(&self) -> Point3<f64> {
        self.nodes[0]
    }

    /// Direction of the tip.
    pub fn direction(&self) -> Unit<Vector3<f64>> {
        Unit::new_normalize(self.tip_mm() - self.nodes[self.nodes.len() - 2])
    }

    /// Nodes of the shaft, hub first, mm.
    pub fn nodes_mm(&self) -> &[Point3<f64>] {
        &self.nodes
    }

    /// Straight segments of the shaft, hub first, mm.
    pub fn segments_mm(&self) -> impl ExactSizeIterator<Item = [Point3<f64>; 2]> + '_ {
        self.nodes.windows(2).map(|pair| [pair[0], pair[1]])
    }

    /// Length of the shaft, mm.
    pub fn length_mm(&self) -> f64 {
        self.segments_mm().map(|[a, b]| (b - a).norm()).sum()
    }

    /// Diameter of the shaft, mm.
    pub fn diameter_mm(&self) -> f64 {
        self.diameter_mm
    }

    /// Returns the needle transformed to another frame; `transform` is rigid.
    pub fn transformed(&self, transform: &Matrix4<f64>) -> Self {
        Self {
            nodes: self.nodes.iter().map(|node| transform.transform_point(node)).collect(),
            diameter_mm: self.diameter_mm,
        }
    }
}

fn coincident(first: usize) -> TrackingError {
    TrackingError::new(format!(
        "needle: nodes {first} and {} of the shaft coincide; expected distinct points",
        first + 1
    ))
}

fn point(key: &'static str, stated: [f64; 3]) -> Result<Point3<f64>, TrackingError> {
    if stated.iter().all(|x| x.abs() <= FARTHEST_MM) {
        Ok(Point3::from(stated))
    } else {
        let expected = "expected finite numbers of at most 1e6";
        Err(TrackingError::at(
            key,
            format!("needle key `{key}` is {stated:?}; {expected}"),
        ))
    }
}

parameters! {
    /// Keys of a needle: `nodes_mm`, or `tip_mm` with `entry_mm` or `direction`.
    pub struct NeedleSpec {
        /// Tip in the world (LPS), mm.
        tip_mm: Option<[f64; 3]>;
        /// Point that the shaft passes through on its way to the tip, such as its entry into the skin, mm.
        entry_mm: Option<[f64; 3]>;
        /// Direction of the needle; any length.
        direction: Option<[f64; 3]>;
        /// A bent shaft: at least two points, hub first, tip last, mm.
        nodes_mm: Option<Vec<[f64; 3]>>;
        /// Length of a straight shaft. Default 150; not with `nodes_mm`.
        length_mm: Option<f64>, in 0.1..=1000;
        /// Diameter, from finer than the finest hypodermic (34 G, 0.18 mm) to wider than a biopsy cannula. Default 1.27
        /// (18 gauge).
        diameter_mm: Option<f64>, in 0.05..=10;
    }
}

impl NeedleSpec {
    /// Returns the pose of the needle.
    pub fn pose(&self) -> Result<NeedlePose, TrackingError> {
        let diameter = self.diameter_mm.unwrap_or(DEFAULT_DIAMETER_MM);
        let length = self.length_mm.unwrap_or(DEFAULT_LENGTH_MM);
        match (&self.nodes_mm, self.tip_mm, self.entry_mm, self.direction) {
            (Some(nodes), None, None, None) if self.length_mm.is_none() => {
                NeedlePose::bent(nodes.iter().copied().map(Point3::from).collect(), diameter)
            }
            (None, Some(tip), Some(entry), None) => {
                let (tip, entry) = (point("tip_mm", tip)?, point("entry_mm", entry)?);
                if (tip - entry).norm() < 1e-9 {
                    return Err(coincident(0));
                }
                NeedlePose::straight(tip, tip - entry, length, diameter)
            }
            (None, Some(tip), None, Some(direction)) => {
                NeedlePose::straight(tip.into(), direction.into(), length, diameter)
            }
            _ => Err(TrackingError::new(format!(
                "a needle needs either `nodes_mm`, or `tip_mm` with one of `entry_mm` and `direction`; found {}",
                self.keys()
            ))),
        }
    }

    fn keys(&self) -> String {
        let keys = [
            ("`nodes_mm`", self.nodes_mm.is_some()),
            ("`tip_mm`", self.tip_mm.is_some()),
            ("`entry_mm`", self.entry_mm.is_some()),
            ("`direction`", self.direction.is_some()),
            ("`length_mm`", self.length_mm.is_some()),
        ];
        let there: Vec<_> = keys.iter().filter(|(_, there)| *there).map(|(key, _)| *key).collect();
        if there.is_empty() {
            "none of them".to_owned()
        } else {
            there.join(", ")
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_straight_needle_runs_back_from_its_tip() {
        let needle = NeedlePose::straight(Point3::new(1.0, 2.0, 3.0), Vector3::new(0.0, 0.0, -2.0), 90.0, 1.0);
        let needle = needle.expect("needle");
        assert_eq!(needle.hub_mm(), Point3::new(1.0, 2.0, 93.0));
        assert_eq!(needle.direction(), -Vector3::z_axis());
        assert_eq!((needle.length_mm(), needle.segments_mm().len()), (90.0, 1));
    }

    #[test]
    fn a_bent_needle_points_where_its_last_piece_does() {
        let nodes = [[0.0, 0.0, 0.0], [0.0, 50.0, 0.0], [0.0, 80.0, 40.0]].map(Point3::from);
        let needle = NeedlePose::bent(nodes.to_vec(), 1.0).expect("needle");
        assert_eq!(needle.length_mm(), 100.0);
        assert!((needle.direction().into_inner() - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-12);
    }

    #[test]
    fn tables_are_read_and_faults_named() {
        let read = |text: &str| toml::from_str::<NeedleSpec>(text).expect(text).pose();
        let needle = read("tip_mm = [0, 40, 0]\nentry_mm = [0, 10, 0]").expect("needle");
        assert_eq!(
            (needle.hub_mm(), needle.diameter_mm()),
            (Point3::new(0.0, -110.0, 0.0), 1.27)
        );
        assert!(read("nodes_mm = [[0, 0, 0], [0, 40, 3]]\ndiameter_mm = 0.7").is_ok());
        let cases = [
            ("", "none of them"),
            ("tip_mm = [0, 0, 0]", "found `tip_mm`"),
            (
                "nodes_mm = [[0, 0, 0], [1, 0, 0]]\ntip_mm = [0, 0, 0]",
                "`nodes_mm`, `tip_mm`",
            ),
            ("nodes_mm = [[0, 0, 0]]", "holds 1 points"),
            ("nodes_mm = [[0, 0, 0], [1, 0, 0], [1, 0, 0]]", "nodes 1 and 2"),
            ("nodes_mm = [[0, 0, nan], [1, 0, 0]]", "`nodes_mm` is [0.0, 0.0, NaN]"),
            ("tip_mm = [1, 0, 0]\nentry_mm = [1, 0, 0]", "coincide"),
            ("tip_mm = [nan, 0, 0]\ndirection = [1, 0, 0]", "`tip_mm` is [NaN"),
            ("tip_mm = [1, 0, 0]\ndirection = [0, 0, 0]", "`direction`"),
            (
                "tip_mm = [1, 0, 0]\ndirection = [1, 0, 0]\nlength_mm = 0",
                "`length_mm` is 0",
            ),
            (
                "tip_mm = [1, 0, 0]\ndirection = [1, 0, 0]\ndiameter_mm = nan",
                "`diameter_mm` is NaN",
            ),
        ];
        for (text, message) in cases {
            let error = read(text).expect_err(text).to_string();
            assert!(error.contains(message), "{error}");
        }
        let line: Vec<String> = (0..=MAX_NODES).map(|at| format!("[{at}, 0, 0]")).collect();
        let error = read(&format!("nodes_mm = [{}]", line.join(", "))).expect_err("too many nodes");
        assert!(
            error.to_string().contains("holds 66 points; expected at most 65"),
            "{error}"
        );
        assert!(read(&format!("nodes_mm = [{}]", line[1..].join(", "))).is_ok());
    }

    proptest! {
        #[test]
        fn a_rigid_motion_keeps_length_and_is_undone(
            angles in prop::array::uniform3(-3.0..3.0f64),
            shift in prop::array::uniform3(-100.0..100.0f64),
            bend in -30.0..30.0f64,
        ) {
            let nodes = vec![Point3::origin(), Point3::new(0.0, 60.0, 0.0), Point3::new(bend, 100.0, 0.0)];
            let needle = NeedlePose::bent(nodes, 1.0).expect("needle");
            let mut motion = nalgebra::Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).to_homogeneous();
            for row in 0..3 {
                motion[(row, 3)] = shift[row];
            }
            let moved = needle.transformed(&motion);
            prop_assert!((moved.length_mm() - needle.length_mm()).abs() < 1e-9);
            let back = moved.transformed(&insonify_base::matrix::inverse_rigid(&motion));
            for (a, b) in back.nodes_mm().iter().zip(needle.nodes_mm()) {
                prop_assert!((a - b).norm() < 1e-9);
            }
        }
    }
}
