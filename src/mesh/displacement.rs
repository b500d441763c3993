//! Analytic displacement fields, which deform a mesh without any mechanics.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify_base::range::{OutOfRange, check};

/// Volume of the image of a cube, as a share of the product of its edges, below which an affine map counts as singular.
const SINGULAR: f64 = 1e-9;

/// Displacement field: a map from reference position (mm) to displacement (mm).
///
/// Directions and axes need not have unit length; they must not be zero.
///
/// ```
/// use insonify_mesh::Displacement;
///
/// let squeeze = Displacement::Compression {
///     fixed_mm: [0.0; 3],
///     direction: [0.0, 0.0, 1.0],
///     strain: 0.1,
///     poisson: 0.5,
/// };
/// squeeze.validate()?;
/// let mut current = Vec::new();
/// squeeze.displace(&[[0.0; 3], [20.0, 0.0, 40.0]], &mut current);
/// // A tenth shorter, and wider by half of that.
/// let [x, _, z] = current[1];
/// assert_eq!(current[0], [0.0; 3]);
/// assert!((z - 36.0).abs() < 1e-12 && (x - 21.0).abs() < 1e-12);
///
/// let torn = Displacement::Compression { fixed_mm: [0.0; 3], direction: [0.0; 3], strain: 0.1, poisson: 0.5 };
/// assert_eq!(torn.validate().unwrap_err().key, "direction");
/// # Ok::<(), insonify_base::range::OutOfRange>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Displacement {
    /// Uniform compression along a direction with lateral expansion: the uniaxial solution of linear elasticity.
    Compression {
        /// A fixed point, mm.
        fixed_mm: [f64; 3],
        /// Direction of compression; its sign has no effect.
        direction: [f64; 3],
        /// Shortening as a fraction of length along the direction, below 1; negative stretches.
        strain: f64,
        /// Poisson's ratio: lateral expansion over axial shortening, -1 to 0.5.
        #[serde(default = "incompressible")]
        poisson: f64,
    },
    /// Indentation as by a probe: a Gaussian bump of displacement `depth exp(-|p - centre|^2 / (2 radius^2))` along a
    /// direction. It folds no tissue while the depth stays below `sqrt(e)` (1.65) radii.
    Indentation {
        /// Point of greatest indentation, mm.
        centre_mm: [f64; 3],
        /// Direction of the indentation, into the tissue.
        direction: [f64; 3],
        /// Displacement at the centre, mm.
        depth_mm: f64,
        /// Standard deviation of the Gaussian, mm, above 0.
        radius_mm: f64,
    },
    /// Simple shear: planes across the normal slide along the direction.
    Shear {
        /// A point of the fixed plane, mm.
        fixed_mm: [f64; 3],
        /// Direction of sliding.
        direction: [f64; 3],
        /// Normal of the sliding planes; only its component across the direction counts.
        normal: [f64; 3],
        /// Sliding per distance from the fixed plane (tangent of the shear angle).
        amount: f64,
    },
    /// Rigid rotation about an axis.
    Rotation {
        /// A point of the axis, mm.
        centre_mm: [f64; 3],
        /// Direction of the axis.
        axis: [f64; 3],
        /// Angle, right-handed, degrees.
        angle_deg: f64,
    },
    /// Rotation about an axis whose angle falls off as `exp(-|p - centre|^2 / (2 radius^2))`.
    Swirl {
        /// Centre of the swirl, mm.
        centre_mm: [f64; 3],
        /// Direction of the axis.
        axis: [f64; 3],
        /// Angle at the centre, right-handed, degrees.
        angle_deg: f64,
        /// Standard deviation of the fall-off, mm, above 0.
        radius_mm: f64,
    },
    /// Any affine map of position: the displacement is `matrix * p - p`.
    Affine {
        /// Row-major homogeneous matrix on column vectors in mm; the last row is 0 0 0 1.
        matrix: [[f64; 4]; 4],
    },
}

/// Soft tissue hardly changes its volume (spec of the tissue models: Poisson's ratio 0.45 to 0.5).
fn incompressible() -> f64 {
    0.5
}

fn position(key: &str, value: &[f64; 3]) -> Result<(), OutOfRange> {
    if value.iter().all(|x| x.is_finite()) {
        Ok(())
    } else {
        Err(OutOfRange::new(key, format!("{value:?}"), "three finite numbers"))
    }
}

fn direction(key: &str, value: &[f64; 3]) -> Result<(), OutOfRange> {
    let expected = "three finite numbers that are not all zero";
    match unit(value) {
        Some(_) => Ok(()),
        None => Err(OutOfRange::new(key, format!("{value:?}"), expected)),
    }
}

fn affine(matrix: &[[f64; 4]; 4]) -> Result<(), OutOfRange> {
    let finite = matrix.iter().flatten().all(|x| x.is_finite());
    let linear = Matrix3::from_fn(|row, column| matrix[row][column]);
    let norms: f64 = linear.column_iter().map(|column| column.norm()).product();
    let solid = linear.determinant().abs() > SINGULAR * norms;
    let expected = "finite, with the last row 0 0 0 1, and directions that span a volume";
    if finite && solid && matrix[3] == [0.0, 0.0, 0.0, 1.0] {
        Ok(())
    } else {
        Err(OutOfRange::new("matrix", format!("{matrix:?}"), expected))
    }
}

impl Displacement {
    /// Returns the `kind` of the field in files.
    pub fn kind(&self) -> &'static str {
        match self {
            Displacement::Compression { .. } => "compression",
            Displacement::Indentation { .. } => "indentation",
            Displacement::Shear { .. } => "shear",
            Displacement::Rotation { .. } => "rotation",
            Displacement::Swirl { .. } => "swirl",
            Displacement::Affine { .. } => "affine",
        }
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`OutOfRange`] for the first that is out of range or not finite.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        match self {
            Displacement::Compression {
                fixed_mm,
                direction: along,
                strain,
                poisson,
            } => {
                position("fixed_mm", fixed_mm)?;
                direction("direction", along)?;
                // Compressed by all of its height the body would be flat, and by more it would be inside out.
                check("strain", *strain, *strain < 1.0, "a fraction below 1")?;
                check(
                    "poisson",
                    *poisson,
                    // Outside these bounds an isotropic material would gain energy by being deformed.
                    (-1.0..=0.5).contains(poisson),
                    "between -1 and 0.5",
                )
            }
            Displacement::Indentation {
                centre_mm,
                direction: along,
                depth_mm,
                radius_mm,
            } => {
                position("centre_mm", centre_mm)?;
                direction("direction", along)?;
                check("depth_mm", *depth_mm, true, "a finite number")?;
                check("radius_mm", *radius_mm, *radius_mm > 0.0, "above 0")
            }
            Displacement::Shear {
                fixed_mm,
                direction: along,
                normal,
                amount,
            } => {
                position("fixed_mm", fixed_mm)?;
                direction("direction", along)?;
                direction("normal", normal)?;
                check("amount", *amount, true, "a finite number")?;
                // Along its own normal it would be a stretch.
                match across(normal, along) {
                    Some(_) => Ok(()),
                    None => Err(OutOfRange::new(
                        "normal",
                        format!("{normal:?}"),
                        "not parallel to `direction`",
                    )),
                }
            }
            Displacement::Rotation {
                centre_mm,
                axis,
                angle_deg,
            } => {
                position("centre_mm", centre_mm)?;
                direction("axis", axis)?;
                check("angle_deg", *angle_deg, true, "a finite number")
            }
            Displacement::Swirl {
                centre_mm,
                axis,
                angle_deg,
                radius_mm,
            } => {
                position("centre_mm", centre_mm)?;
                direction("axis", axis)?;
                check("angle_deg", *angle_deg, true, "a finite number")?;
                check("radius_mm", *radius_mm, *radius_mm > 0.0, "above 0")
            }
            Displacement::Affine { matrix } => affine(matrix),
        }
    }

    /// Returns the displacement (mm) of the point with reference position `p` (mm): zero for a field that
    /// [`Displacement::validate`] rejects for a zero direction.
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        self.field(Vector3::from(p)).unwrap_or_else(Vector3::zeros).into()
    }

    /// Writes the current positions (mm) of nodes at the reference positions `nodes` (mm) into `current`, reusing its
    /// memory.
    pub fn displace(&self, nodes: &[[f64; 3]], current: &mut Vec<[f64; 3]>) {
        current.clear();
        current.extend(nodes.iter().map(|&node| {
            let u = self.apply(node);
            [node[0] + u[0], node[1] + u[1], node[2] + u[2]]
        }));
    }

    fn field(&self, p: Vector3<f64>) -> Option<Vector3<f64>> {
        Some(match self {
            Displacement::Compression {
                fixed_mm,
                direction,
                strain,
                poisson,
            } => {
                // Across the compression a free body widens by Poisson's ratio of its strain.
                let (r, d) = (p - Vector3::from(*fixed_mm), unit(direction)?);
                let along = d.into_inner() * d.dot(&r);
                (r - along) * (poisson * strain) - along * *strain
            }
            Displacement::Indentation {
                centre_mm,
                direction,
                depth_mm,
                radius_mm,
            } => unit(direction)?.into_inner() * (depth_mm * bump(p, centre_mm, *radius_mm)),
            Displacement::Shear {
                fixed_mm,
                direction,
                normal,
                amount,
            } => {
                // Only the part of `normal` across the direction counts, so that a shear keeps the volume.
                let height = across(normal, direction)?.dot(&(p - Vector3::from(*fixed_mm)));
                unit(direction)?.into_inner() * (amount * height)
            }
            Displacement::Rotation {
                centre_mm,
                axis,
                angle_deg,
            } => turn(p, centre_mm, unit(axis)?, *angle_deg),
            Displacement::Swirl {
                centre_mm,
                axis,
                angle_deg,
                radius_mm,
            } => turn(p, centre_mm, unit(axis)?, angle_deg * bump(p, centre_mm, *radius_mm)),
            Displacement::Affine { matrix } => {
                Vector3::from(std::array::from_fn(|i| {
                    matrix[i][0] * p.x + matrix[i][1] * p.y + matrix[i][2] * p.z + matrix[i][3]
                })) - p
            }
        })
    }
}

fn unit(direction: &[f64; 3]) -> Option<Unit<Vector3<f64>>> {
    // Where the square of a length underflows or overflows, the quotient is no unit vector.
    let finite = direction.iter().all(|x| x.is_finite());
    Unit::try_new(Vector3::from(*direction), 0.0).filter(|unit| finite && unit.norm() > 0.5)
}

/// Returns the unit vector of the component of `normal` across `direction`.
fn across(normal: &[f64; 3], direction: &[f64; 3]) -> Option<Unit<Vector3<f64>>> {
    let (n, d) = (unit(normal)?, unit(direction)?);
    Unit::try_new(n.into_inner() - d.into_inner() * d.dot(&n), 1e-9)
}

fn bump(p: Vector3<f64>, centre: &[f64; 3], radius: f64) -> f64 {
    (-(p - Vector3::from(*centre)).norm_squared() / (2.0 * radius * radius)).exp()
}

fn turn(p: Vector3<f64>, centre: &[f64; 3], axis: Unit<Vector3<f64>>, degrees: f64) -> Vector3<f64> {
    let r = p - Vector3::from(*centre);
    Rotation3::from_axis_angle(&axis, degrees.to_radians()) * r - r
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Displacement, toml::de::Error> {
        toml::from_str(text)
    }

    fn close(a: [f64; 3], b: [f64; 3]) {
        assert!(
            a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-12),
            "{a:?} is not {b:?}"
        );
    }

    #[test]
    fn compression_is_the_uniaxial_solution() {
        let field =
            parse("kind = 'compression'\nfixed_mm = [1, 2, 3]\ndirection = [0, 0, 9]\nstrain = 0.1\npoisson = 0.4")
                .unwrap();
        close(field.apply([11.0, 2.0, 13.0]), [0.4, 0.0, -1.0]);
        let volume_kept =
            parse("kind = 'compression'\nfixed_mm = [0, 0, 0]\ndirection = [1, 0, 0]\nstrain = 0.1").unwrap();
        close(volume_kept.apply([10.0, 10.0, 0.0]), [-1.0, 0.5, 0.0]);
    }

    #[test]
    fn indentation_is_deepest_at_its_centre_and_falls_as_a_gaussian() {
        let field =
            parse("kind = 'indentation'\ncentre_mm = [1, 1, 1]\ndirection = [0, 2, 0]\ndepth_mm = 8\nradius_mm = 10")
                .unwrap();
        close(field.apply([1.0; 3]), [0.0, 8.0, 0.0]);
        close(field.apply([11.0, 1.0, 1.0]), [0.0, 8.0 * (-0.5f64).exp(), 0.0]);
    }

    #[test]
    fn shear_slides_along_its_direction_only() {
        let field =
            parse("kind = 'shear'\nfixed_mm = [0, 0, 1]\ndirection = [1, 0, 0]\nnormal = [1, 0, 1]\namount = 0.5")
                .unwrap();
        close(field.apply([7.0, 5.0, 3.0]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn rotation_keeps_distances_and_swirl_fades() {
        let rotation = parse("kind = 'rotation'\ncentre_mm = [1, 0, 0]\naxis = [0, 0, 5]\nangle_deg = 90").unwrap();
        close(rotation.apply([2.0, 0.0, 4.0]), [-1.0, 1.0, 0.0]);
        let swirl =
            parse("kind = 'swirl'\ncentre_mm = [0, 0, 0]\naxis = [0, 0, 1]\nangle_deg = 90\nradius_mm = 2").unwrap();
        let (sin, cos) = (90.0 * (-0.5f64).exp()).to_radians().sin_cos();
        close(swirl.apply([2.0, 0.0, 0.0]), [2.0 * cos - 2.0, 2.0 * sin, 0.0]);
        close(swirl.apply([100.0, 0.0, 0.0]), [0.0; 3]);
    }

    #[test]
    fn affine_maps_and_displaces_many() {
        let field =
            parse("kind = 'affine'\nmatrix = [[2, 0, 0, 1], [0, 1, 1, 0], [0, 0, 1, 0], [0, 0, 0, 1]]").unwrap();
        assert_eq!(field.validate(), Ok(()));
        // Whether directions span a volume does not depend on their lengths.
        for scale in [1e-3, 1e3] {
            let map = |z: [f64; 3]| Displacement::Affine {
                matrix: [
                    [scale, 0.0, z[0], 0.0],
                    [0.0, scale, z[1], 0.0],
                    [0.0, 0.0, z[2], 0.0],
                    [0.0, 0.0, 0.0, 1.0],
                ],
            };
            assert_eq!(map([0.0, 0.0, scale]).validate(), Ok(()));
            assert!(map([scale, scale, 1e-13 * scale]).validate().is_err());
        }
        let mut current = vec![[9.0; 3]; 7];
        field.displace(&[[3.0, 4.0, 5.0]], &mut current);
        assert_eq!(current, [[7.0, 9.0, 5.0]]);
    }

    #[test]
    fn out_of_range_parameters_name_their_key() {
        let key = |text: &str| parse(text).unwrap().validate().unwrap_err().key;
        let indentation = "kind = 'indentation'\ncentre_mm = [1, 1, 1]\n";
        assert_eq!(
            key(&format!(
                "{indentation}direction = [0, 0, 0]\ndepth_mm = 8\nradius_mm = 1"
            )),
            "direction"
        );
        assert_eq!(
            key(&format!(
                "{indentation}direction = [0, 0, 1]\ndepth_mm = nan\nradius_mm = 1"
            )),
            "depth_mm"
        );
        assert_eq!(
            key(&format!(
                "{indentation}direction = [0, 0, 1]\ndepth_mm = 8\nradius_mm = 0"
            )),
            "radius_mm"
        );
        let compression = "kind = 'compression'\nfixed_mm = [0, 0, inf]\ndirection = [0, 1, 0]\nstrain = 0.5";
        assert_eq!(key(compression), "fixed_mm");
        assert_eq!(key(&compression.replace("inf", "0").replace("0.5", "1.0")), "strain");
        let shear = "kind = 'shear'\nfixed_mm = [0, 0, 1]\ndirection = [1, 0, 0]\nnormal = [-3, 0, 0]\namount = 0.5";
        assert_eq!(key(shear), "normal");
        assert_eq!(
            key("kind = 'affine'\nmatrix = [[2, 0, 0, 1], [0, 1, 1, 0], [0, 0, 1, 0], [0, 0, 1, 1]]"),
            "matrix"
        );
        for linear in [
            "[0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 0]",
            "[1, 2, 0, 0], [2, 4, 0, 0], [0, 0, 1, 0]",
        ] {
            assert_eq!(
                key(&format!("kind = 'affine'\nmatrix = [{linear}, [0, 0, 0, 1]]")),
                "matrix"
            );
        }
    }

    #[test]
    fn unknown_keys_and_kinds_are_errors() {
        let text = "kind = 'rotation'\ncentre_mm = [1, 0, 0]\naxis = [0, 0, 5]\nangle_deg = 90\nangle = 3";
        assert!(parse(text).unwrap_err().to_string().contains("angle"));
        assert!(parse("kind = 'stretch'").is_err());
    }
}
