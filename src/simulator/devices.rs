//! Support for haptic devices (Goksel et al. 2011, section V-C): a probe driven at two points, damping, and a needle
//! that goes through the holes of a template while its device stays in one place.
//!
//! Velocities are differences of positions over a step, so they lag by half a step: see [`Damper::most_ns_per_mm`].

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::SimulatorError;
use insonify_mechanics::insertion::{Instruments, Outcome, Wrench, lever, pointed};
use insonify_tracking::template::Template;

/// Two points on the axis of a probe, each driven by a device that measures and renders three axes.
///
/// ```
/// use insonify::{Damper, TwoPoints};
/// use nalgebra::{Isometry3, Point3};
///
/// // Devices hold a probe 90 and 150 mm behind its end; they measure one point 1 mm too far from the other.
/// let points = TwoPoints::new([90.0, 150.0])?;
/// let measured = [Point3::new(0.0, 0.0, -90.0), Point3::new(0.0, 0.0, -151.0)];
/// let probe = points.pose(&measured, &Isometry3::identity())?;
/// assert!((probe.stretch_mm - 1.0).abs() < 1e-9);
/// assert!((probe.pose.translation.z + 0.5).abs() < 1e-9, "half of it at each point");
///
/// // Against 1 mm in 1 ms, 0.01 N s/mm are 10 N.
/// let mut damper = Damper::new(0.01)?;
/// damper.force(&Point3::origin(), 1e-3);
/// assert!((damper.force(&Point3::new(1.0, 0.0, 0.0), 1e-3).x + 10.0).abs() < 1e-9);
/// # Ok::<(), insonify::SimulatorError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoPoints {
    at_mm: [f64; 2],
}

/// Pose of a probe from two measured points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointsPose {
    /// Probe frame to world (see [`ProbeContact`](insonify_mechanics::insertion::ProbeContact)).
    pub pose: Isometry3<f64>,
    /// Excess of the distance between the points over that on the probe, mm, due to calibration and play of the
    /// devices. The pose leaves half of it at each point.
    pub stretch_mm: f64,
}

impl TwoPoints {
    /// Takes points that lie `at_mm` (mm, at least 1 apart) behind the origin of the probe, as in
    /// [`ProbeContact::driven_at_mm`](insonify_mechanics::insertion::ProbeContact::driven_at_mm).
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn new(at_mm: [f64; 2]) -> Result<Self, SimulatorError> {
        let distance_mm = (at_mm[0] - at_mm[1]).abs();
        SimulatorError::check(
            "at_mm",
            distance_mm,
            distance_mm >= 1.0,
            "two points at least 1 mm apart",
        )
        .map(|()| Self { at_mm })
    }

    /// Returns the pose of a probe from its measured points, mm, world. Two points do not determine the roll about the
    /// axis: it is that of `last`, carried along by the shortest rotation.
    ///
    /// # Errors
    /// [`SimulatorError`] where the points are less than half as far apart as on the probe.
    pub fn pose(&self, points: &[Point3<f64>; 2], last: &Isometry3<f64>) -> Result<PointsPose, SimulatorError> {
        let nominal = self.at_mm[1] - self.at_mm[0];
        let between = (points[0] - points[1]) * nominal.signum();
        let (distance_mm, nominal) = (between.norm(), nominal.abs());
        let expected = format!("two points about {nominal} mm apart");
        SimulatorError::check("points", distance_mm, distance_mm >= 0.5 * nominal, &expected)?;
        let axis = between / distance_mm;
        let middle = nalgebra::center(&points[0], &points[1]);
        let origin = middle + axis * (0.5 * (self.at_mm[0] + self.at_mm[1]));
        Ok(PointsPose {
            pose: Isometry3::from_parts(origin.into(), pointed(&last.rotation, &axis)),
            stretch_mm: distance_mm - nominal,
        })
    }

    /// Returns the forces on the points, N, that are equivalent to a wrench on the probe at `pose`, about its origin:
    /// see [`ProbeContact::split`](insonify_mechanics::insertion::ProbeContact::split).
    pub fn split(&self, wrench: &Wrench, pose: &Isometry3<f64>) -> [Vector3<f64>; 2] {
        lever(self.at_mm, wrench, pose)
    }
}

/// Velocity of a device by differences, mm/s: zero at first, and where a position or time is not finite.
#[derive(Clone, Copy, Debug, Default)]
struct Velocity(Option<Point3<f64>>);

impl Velocity {
    fn next(&mut self, position: &Point3<f64>, dt_s: f64) -> Vector3<f64> {
        let previous = self.0.replace(*position).unwrap_or(*position);
        let velocity = (position - previous) / dt_s;
        if dt_s > 0.0 && velocity.iter().all(|v| v.is_finite()) {
            velocity
        } else {
            Vector3::zeros()
        }
    }
}

/// Damping of a device, which keeps the haptic loop stable.
#[derive(Clone, Copy, Debug)]
pub struct Damper {
    c_ns_per_mm: f64,
    velocity: Velocity,
}

impl Damper {
    /// Builds a damper with a force of `c_ns_per_mm` (N s/mm, above 0) per mm/s, against the motion.
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn new(c_ns_per_mm: f64) -> Result<Self, SimulatorError> {
        SimulatorError::check("c_ns_per_mm", c_ns_per_mm, c_ns_per_mm > 0.0, "a number above 0").map(|()| Self {
            c_ns_per_mm,
            velocity: Velocity::default(),
        })
    }

    /// Returns the damping from which a free device of a mass (kg) would become unstable, N s/mm: 2 m/dt, where its
    /// position is sampled every `dt_s` and the force held until the next sample. With springs and tissue the limit is
    /// lower.
    pub fn most_ns_per_mm(mass_kg: f64, dt_s: f64) -> f64 {
        2e-3 * mass_kg / dt_s
    }

    /// Returns the force on the device at its current position, `dt_s` after the previous call, N: zero at the first
    /// call.
    pub fn force(&mut self, place_mm: &Point3<f64>, dt_s: f64) -> Vector3<f64> {
        self.velocity.next(place_mm, dt_s) * -self.c_ns_per_mm
    }
}

/// Parameters of the PID controller of [`LateralHold`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldOptions {
    /// Proportional gain: force per mm of lateral offset, N/mm (above 0).
    pub kp_n_per_mm: f64,
    /// Integral gain: growth of the force per second and mm of lateral offset, N/(mm s) (0 or more).
    pub ki_n_per_mm_s: f64,
    /// Derivative gain: force per mm/s of lateral velocity, N s/mm (0 or more).
    pub kd_ns_per_mm: f64,
    /// Limit of the force, and of the integral's part in it, N (above 0).
    pub most_n: f64,
}

/// Lateral hold: keeps the device of a needle on the axis of its hole, and leaves it free along the axis.
#[derive(Clone, Copy, Debug)]
pub struct LateralHold {
    options: HoldOptions,
    integral_n: Vector3<f64>,
    velocity: Velocity,
}

impl LateralHold {
    /// Builds a hold for a device at rest.
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn new(options: HoldOptions) -> Result<Self, SimulatorError> {
        let (above, least) = ("a number above 0", "a number of 0 or more");
        SimulatorError::check("kp_n_per_mm", options.kp_n_per_mm, options.kp_n_per_mm > 0.0, above)?;
        SimulatorError::check(
            "ki_n_per_mm_s",
            options.ki_n_per_mm_s,
            options.ki_n_per_mm_s >= 0.0,
            least,
        )?;
        SimulatorError::check("kd_ns_per_mm", options.kd_ns_per_mm, options.kd_ns_per_mm >= 0.0, least)?;
        SimulatorError::check("most_n", options.most_n, options.most_n > 0.0, above)?;
        Ok(Self {
            options,
            integral_n: Vector3::zeros(),
            velocity: Velocity::default(),
        })
    }

    /// Returns the force on the device at its current position, `dt_s` after the previous call, towards the line
    /// through `hole_mm` along `axis`, N: zero where a position is not finite.
    pub fn force(
        &mut self,
        place_mm: &Point3<f64>,
        hole_mm: &Point3<f64>,
        axis: &Unit<Vector3<f64>>,
        dt_s: f64,
    ) -> Vector3<f64> {
        let across = |v: Vector3<f64>| v - axis.into_inner() * axis.dot(&v);
        let HoldOptions {
            kp_n_per_mm: kp,
            ki_n_per_mm_s: ki,
            kd_ns_per_mm: kd,
            most_n,
        } = self.options;
        let aside = across(hole_mm - place_mm);
        let velocity = across(self.velocity.next(place_mm, dt_s));
        let grown = across(self.integral_n) + aside * (ki * dt_s.max(0.0));
        if grown.iter().all(|n| n.is_finite()) {
            self.integral_n = grown.cap_magnitude(most_n);
        }
        let force = aside * kp + self.integral_n - velocity * kd;
        if force.iter().all(|n| n.is_finite()) {
            force.cap_magnitude(most_n)
        } else {
            Vector3::zeros()
        }
    }
}

/// A needle that goes through a hole of a template, moved by a device that stays in place: the motion of the device
/// along its axis and its roll are applied at the chosen hole.
///
/// ```
/// use insonify::{HoldOptions, LateralHold, Template, TemplateGuided};
/// use nalgebra::{Isometry3, Point3, Vector3};
///
/// let names = |letters: &str| letters.chars().map(String::from).collect();
/// let template = Template {
///     origin_mm: Point3::new(20.0, 20.0, -5.0),
///     steps_mm: [Vector3::x() * 5.0, Vector3::y() * 5.0],
///     direction: Vector3::z_axis(),
///     columns: names("AB"),
///     rows: names("12"),
/// };
/// let needle = TemplateGuided::new(template, "B1", Point3::origin())?;
/// let instruments = needle.instruments(&Isometry3::translation(0.0, 0.0, -180.0));
/// assert_eq!(instruments.guide, Some(Point3::new(25.0, 20.0, -5.0)));
/// assert_eq!(instruments.base.translation.vector, Vector3::new(25.0, 20.0, -185.0));
///
/// // The device itself is held on its own axis.
/// let options = HoldOptions { kp_n_per_mm: 2.0, ki_n_per_mm_s: 0.0, kd_ns_per_mm: 0.0, most_n: 6.0 };
/// let mut hold = LateralHold::new(options)?;
/// let force = hold.force(&Point3::new(1.0, 0.0, -180.0), &Point3::origin(), &Vector3::z_axis(), 1e-3);
/// assert!((force - Vector3::new(-2.0, 0.0, 0.0)).norm() < 1e-9);
/// # Ok::<(), insonify::SimulatorError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TemplateGuided {
    template: Template,
    hole_mm: Point3<f64>,
    device_mm: Point3<f64>,
}

impl TemplateGuided {
    /// Places a needle outside the body, at a hole. `device_mm` is the position of the device's own guide, in its frame
    /// of axes parallel to the world's, mm: it corresponds to the hole for the virtual needle.
    ///
    /// # Errors
    /// [`SimulatorError::Hole`].
    pub fn new(template: Template, hole: &str, device_mm: Point3<f64>) -> Result<Self, SimulatorError> {
        Ok(Self {
            hole_mm: template.hole(hole)?,
            template,
            device_mm,
        })
    }

    /// Chooses another hole for the next instruments. `outcome` is that of the last step.
    ///
    /// # Errors
    /// [`SimulatorError`]; the hole is then unchanged.
    pub fn choose(&mut self, hole: &str, outcome: &Outcome) -> Result<(), SimulatorError> {
        let hole_mm = self.template.hole(hole)?;
        let inserted_mm = outcome.inserted_mm;
        // A needle that dents the skin is not in yet.
        if inserted_mm > 0.0 || outcome.contacts > 0 {
            return Err(SimulatorError::Inserted { inserted_mm });
        }
        self.hole_mm = hole_mm;
        Ok(())
    }

    /// Returns the centre of the hole, mm: the guide of the needle.
    pub fn hole_mm(&self) -> Point3<f64> {
        self.hole_mm
    }

    /// Returns the instruments for a device whose base frame is `device` (to its own axes): the needle is on the axis
    /// of the hole, as far along it as the device is beyond its guide, and rolled about it as the device is.
    pub fn instruments(&self, device: &Isometry3<f64>) -> Instruments {
        let axis = self.template.direction.into_inner();
        let depth = axis.dot(&(device.translation.vector - self.device_mm.coords));
        Instruments {
            base: Isometry3::from_parts((self.hole_mm + axis * depth).into(), pointed(&device.rotation, &axis)),
            probe: None,
            guide: Some(self.hole_mm),
            deposit: false,
        }
    }
}
