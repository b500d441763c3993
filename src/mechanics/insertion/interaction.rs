//! Anatomy at rest as seen by a needle: regions in space and their interactions with the needle.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::validation::{self, InvalidSetup};
use insonify_base::range::{OutOfRange, Ranges, check, parameters};
use insonify_mesh::{Locator, NO_ELEMENT, TetMesh};

/// Distance between samples around the tip, mm.
const AROUND_MM: f64 = 0.25;

parameters! {
    /// Force per length near the tip that some tissues show in place of a cutting force at the tip alone: the
    /// three-parameter density (peak, width, shaft) of Dehghan et al. 2008, section "Needle shaft force distribution".
    /// Beyond `width_mm` from the tip it is [`Interaction::friction_n_per_mm`]. Each length of shaft has the parameters
    /// of the tissue that surrounds it, so that the force is continuous where the tip crosses from one tissue into
    /// another.
    #[derive(Copy)]
    pub struct Peak with required keys {
        /// Force per length within `width_mm` of the tip while the needle cuts, in place of the friction there.
        density_n_per_mm: f64, in 0 "N/mm";
        /// Length from the tip over which the peak acts.
        width_mm: f64, above 0 "mm";
    }
}

parameters! {
    /// Bone: a penalty force on the tip, against its direction, in proportion to its depth in the bone. The depth of
    /// the tip is limited to `penetration_mm`: from there on the needle lags behind the hand, and the force stays at
    /// its limit, `stiffness_n_per_mm` x `penetration_mm`.
    #[derive(Copy)]
    pub struct Bone with required keys {
        /// Force per mm of depth.
        stiffness_n_per_mm: f64, above 0 "N/mm";
        /// Maximum depth of the tip. At the end of the step in which bone is met, the mass-spring model may exceed it
        /// by the advance in one substep.
        penetration_mm: f64, above 0 "mm";
    }
}

impl Bone {
    /// Returns the magnitude of the penalty where the hand demands a depth of the tip of `asked_mm`, N.
    pub(super) fn force_n(&self, asked_mm: f64) -> f64 {
        self.stiffness_n_per_mm * asked_mm.clamp(0.0, self.penetration_mm)
    }

    /// State after a needle has slid sideways off bone: no force; the needle catches up with the hand.
    pub(super) const LEFT: Self = Self {
        stiffness_n_per_mm: 0.0,
        penetration_mm: 0.0,
    };

    /// Returns whether the bone exerts a force.
    pub(super) fn holds(&self) -> bool {
        self.stiffness_n_per_mm > 0.0
    }

    /// Returns whether bone lies along `direction` in the tissue at rest, from 0.25 mm behind a point to 0.25 mm beyond
    /// the largest penetration.
    pub(super) fn is_in_front(&self, anatomy: &dyn Anatomy, at_rest: &Point3<f64>, direction: &Vector3<f64>) -> bool {
        let samples = ((self.penetration_mm + 2.0 * AROUND_MM) / AROUND_MM).ceil() as usize;
        (0..=samples).any(|sample| {
            let point = at_rest + direction * (AROUND_MM * (sample as f64 - 1.0));
            interaction(anatomy, anatomy.region(&point)).bone.is_some()
        })
    }

    /// Returns the lag of the needle behind the hand at a demanded depth of `asked_mm`, mm.
    pub(super) fn behind_mm(&self, asked_mm: f64) -> f64 {
        (asked_mm - self.penetration_mm).max(0.0)
    }
}

/// Interaction between a needle and one tissue (Goksel et al. 2011, section III-A).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interaction {
    /// Sliding friction per length of shaft, N/mm (0 or more).
    pub friction_n_per_mm: f64,
    /// Ratio of static to sliding friction (1 or more).
    pub static_ratio: f64,
    /// Cutting force at the advancing tip, N (0 or more).
    pub cutting_n: f64,
    /// Force at the tip that breaks the surface of this tissue, N: where it is more than `cutting_n`, the tip pushes
    /// the tissue until this force is reached.
    pub puncture_n: f64,
    /// Force density along the shaft near the advancing tip, in place of the friction there.
    pub peak: Option<Peak>,
    /// Properties of bone, if the tissue is bone.
    pub bone: Option<Bone>,
    /// Whether the tissue must not be hit; a hit is reported as an event.
    pub critical: bool,
}

impl Default for Interaction {
    /// Returns an interaction without friction and cutting force.
    fn default() -> Self {
        Interaction {
            friction_n_per_mm: 0.0,
            static_ratio: 1.0,
            cutting_n: 0.0,
            puncture_n: 0.0,
            peak: None,
            bone: None,
            critical: false,
        }
    }
}

impl Interaction {
    /// Returns the sliding force on a length of shaft in this tissue from `near_mm` to `far_mm` behind the tip, N. Of
    /// the last `cut_mm` cut by the tip, the part near it has the density of the peak.
    pub(super) fn shaft_n(&self, ends_mm: [f64; 2], cut_mm: f64) -> f64 {
        shaft_n(self.friction_n_per_mm, self.peak, ends_mm, cut_mm)
    }

    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn check(&self) -> Result<(), OutOfRange> {
        for (key, found) in [
            ("friction_n_per_mm", self.friction_n_per_mm),
            ("cutting_n", self.cutting_n),
            ("puncture_n", self.puncture_n),
        ] {
            check(key, found, found >= 0.0, "a finite number of 0 or more")?;
        }
        let ratio = self.static_ratio;
        check("static_ratio", ratio, ratio >= 1.0, "a finite number of 1 or more")?;
        self.peak.map_or(Ok(()), |peak| peak.check_ranges())?;
        self.bone.map_or(Ok(()), |bone| bone.check_ranges())
    }
}

/// [`Interaction::shaft_n`] of a friction and a peak.
pub(super) fn shaft_n(friction_n_per_mm: f64, peak: Option<Peak>, [near_mm, far_mm]: [f64; 2], cut_mm: f64) -> f64 {
    let peak = peak.map_or([0.0; 2], |peak| {
        let within = (far_mm.min(peak.width_mm).min(cut_mm) - near_mm).max(0.0);
        [within, within * peak.density_n_per_mm]
    });
    (far_mm - near_mm - peak[0]).max(0.0) * friction_n_per_mm + peak[1]
}

/// Regions of the body and their interactions with a needle, independent of any mesh. Of the crate `insonify` it is
/// `InsertionAnatomy`; `Anatomy` is what frames show there.
pub trait Anatomy: Send + Sync + Debug {
    /// Returns the region at a point of the undeformed body (mm), or `None` outside the body.
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32>;

    /// Returns the interaction of a region with a needle. One that fails [`Interaction::check`] is replaced by the
    /// default.
    fn interaction(&self, region: i32) -> Interaction;

    /// Returns the plane-strain modulus E/(1 - nu^2) of a region, kPa; `None`, the default, where that of the region's
    /// elements holds.
    fn modulus_kpa(&self, _region: i32) -> Option<f64> {
        None
    }
}

/// Least distance in the tissue at rest between two crossings of a boundary, mm: a tip that wanders along a boundary
/// crosses it once. Bone and critical regions are entered at once.
pub(super) const BORDER_MM: f64 = 0.5;

/// Returns the interaction of a region with a needle, the default (no force) outside the body.
pub(super) fn interaction(anatomy: &dyn Anatomy, region: Option<i32>) -> Interaction {
    region
        .map(|region| anatomy.interaction(region))
        .filter(|interaction| interaction.check().is_ok())
        .unwrap_or_default()
}

impl<T: Anatomy + ?Sized> Anatomy for Arc<T> {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        self.as_ref().region(at_rest_mm)
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.as_ref().interaction(region)
    }

    fn modulus_kpa(&self, region: i32) -> Option<f64> {
        self.as_ref().modulus_kpa(region)
    }
}

/// Regions of the elements of a mesh, before any of its nodes was moved.
#[derive(Debug)]
pub struct MeshRegions {
    mesh: Arc<TetMesh>,
    locator: Arc<Locator<f64>>,
    interactions: BTreeMap<i32, Interaction>,
}

impl MeshRegions {
    /// Takes the regions of a mesh with their interactions; a region that is not listed exerts no force.
    ///
    /// # Errors
    /// [`InvalidSetup`]: a number out of range, a region listed twice, none that is of the mesh.
    pub fn new(mesh: &Arc<TetMesh>, interactions: &[(i32, Interaction)]) -> Result<MeshRegions, InvalidSetup> {
        validation::interactions(mesh, interactions)?;
        Ok(MeshRegions::located(mesh, Arc::new(Locator::new(mesh)), interactions))
    }

    pub(super) fn located(
        mesh: &Arc<TetMesh>,
        locator: Arc<Locator<f64>>,
        interactions: &[(i32, Interaction)],
    ) -> MeshRegions {
        MeshRegions {
            mesh: Arc::clone(mesh),
            locator,
            interactions: interactions.iter().copied().collect(),
        }
    }
}

impl Anatomy for MeshRegions {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        let hit = self.locator.locate((*at_rest_mm).into(), NO_ELEMENT);
        (hit.element != NO_ELEMENT).then(|| self.mesh.regions()[hit.element as usize])
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.interactions.get(&region).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depth and force are limited, the lag of the needle is not.
    #[test]
    fn bone_pushes_back_up_to_a_limit() {
        let bone = Bone {
            stiffness_n_per_mm: 40.0,
            penetration_mm: 0.5,
        };
        for (depth_mm, force, behind) in [(-1.0, 0.0, 0.0), (0.25, 10.0, 0.0), (0.5, 20.0, 0.0), (10.0, 20.0, 9.5)] {
            assert_eq!((bone.force_n(depth_mm), bone.behind_mm(depth_mm)), (force, behind));
        }
    }

    /// Within 6 mm of the tip 0.1 N/mm, behind that 0.02 N/mm.
    #[test]
    fn the_peak_replaces_the_friction_near_the_tip() {
        let tissue = Interaction {
            friction_n_per_mm: 0.02,
            peak: Some(Peak {
                density_n_per_mm: 0.1,
                width_mm: 6.0,
            }),
            ..Interaction::default()
        };
        for (from, to, cutting, resting) in [
            (0.0, 6.0, 0.6, 0.12),
            (2.0, 10.0, 0.4 + 0.08, 0.16),
            (7.0, 9.0, 0.04, 0.04),
            (3.0, 3.0, 0.0, 0.0),
        ] {
            let forces = [f64::INFINITY, 0.0].map(|cut_mm| tissue.shaft_n([from, to], cut_mm));
            assert!((forces[0] - cutting).abs() < 1e-15 && (forces[1] - resting).abs() < 1e-15);
        }
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        assert_eq!(Interaction::default().check(), Ok(()));
        type Spoil = fn(&mut Interaction);
        let spoils: [(&str, Spoil); 8] = [
            ("friction_n_per_mm", |interaction| interaction.friction_n_per_mm = -0.1),
            ("static_ratio", |interaction| interaction.static_ratio = 0.99),
            ("cutting_n", |interaction| interaction.cutting_n = f64::NAN),
            ("puncture_n", |interaction| interaction.puncture_n = f64::INFINITY),
            ("density_n_per_mm", |interaction| {
                interaction.peak = Some(Peak {
                    density_n_per_mm: -1.0,
                    width_mm: 1.0,
                })
            }),
            ("width_mm", |interaction| {
                interaction.peak = Some(Peak {
                    density_n_per_mm: 1.0,
                    width_mm: 0.0,
                })
            }),
            ("stiffness_n_per_mm", |interaction| {
                interaction.bone = Some(Bone {
                    stiffness_n_per_mm: 0.0,
                    penetration_mm: 1.0,
                })
            }),
            ("penetration_mm", |interaction| {
                interaction.bone = Some(Bone {
                    stiffness_n_per_mm: 1.0,
                    penetration_mm: -1.0,
                })
            }),
        ];
        for (key, spoil) in spoils {
            let mut interaction = Interaction::default();
            spoil(&mut interaction);
            assert_eq!(interaction.check().map_err(|error| error.key), Err(key.to_owned()));
        }
    }
}
