//! Rendering plan: the passes and resources that a scene needs, each with its reason.
//!
//! The plan makes no decisions: every effect of the registry states whether the scene calls for it. What a plan does
//! not list is not built: no pipeline, no buffer, no dispatch.

use std::collections::BTreeSet;
use std::fmt;

use serde::Serialize;

use crate::effects::buffers::{self, Buffer};
use crate::effects::pass::{Band, Pass};
use crate::effects::table::{Origin, Origins};
use crate::effects::{EVERY_FRAME, REGISTRY, Wanted};
use crate::fusion::{Bound, Fused, MAX_BUFFERS, fuse};
use crate::quality::Picked;
use crate::synth::tables::Tables;

/// One pass of a plan.
pub struct PlannedPass {
    /// Declaration of the pass.
    pub pass: &'static Pass,
    /// Name of the effect that the pass belongs to.
    pub effect: &'static str,
    /// Name of what needs it, if that is not the effect.
    pub needed_by: Option<&'static str>,
    /// Why the scene calls for it.
    pub reason: String,
}

/// An effect that the scene does not use.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Omitted {
    /// Name of the effect.
    pub name: &'static str,
    /// Reason for the omission.
    pub reason: String,
}

/// A buffer and its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PlannedResource {
    /// The buffer.
    pub resource: &'static Buffer,
    /// Size on the GPU, bytes.
    pub bytes: u64,
}

/// Passes and resources of a frame.
///
/// ```
/// use insonify_imaging::effects::Effects;
/// use insonify_imaging::scene::SceneFile;
/// use insonify_imaging::synth::Backend;
///
/// let text = "volume = { phantom = \"abdomen\", resolution_mm = 5 }";
/// let mut scene = SceneFile::parse(text, "scene.toml")?.resolve(".".as_ref())?;
/// let usual = scene.synthesizer(Backend::Cpu)?;
/// let usual = usual.plan();
/// assert!(usual.has("speckle") && !usual.has("needle") && !usual.has("warp"));
/// println!("{}", usual.report(&scene.origins));
///
/// scene.settings.effects = Effects::default();
/// let slicing = scene.synthesizer(Backend::Cpu)?;
/// let slicing = slicing.plan();
/// assert!(slicing.passes.len() < usual.passes.len() && slicing.bytes() < usual.bytes());
/// assert!(slicing.without.iter().any(|omitted| omitted.name == "speckle"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Plan {
    /// Passes in order of execution.
    pub passes: Vec<PlannedPass>,
    /// Effects that the scene does not use.
    pub without: Vec<Omitted>,
    /// Resources that the passes bind.
    pub resources: Vec<PlannedResource>,
    /// Deviations of the output from what the scene requests.
    pub warnings: Vec<String>,
}

impl Plan {
    /// Builds the plan of a scene.
    pub fn new(tables: &Tables) -> Self {
        let (mut passes, mut without) = (Vec::new(), Vec::new());
        for effect in REGISTRY {
            match (effect.wanted)(tables) {
                Wanted::Yes(reason) => passes.extend((effect.passes)(tables).into_iter().map(|pass| {
                    let needed_by = match effect.remove {
                        None => Some(EVERY_FRAME),
                        Some(_) => (effect.needed_by)(tables, pass),
                    };
                    let other = REGISTRY.iter().find(|other| Some(other.name) == needed_by);
                    PlannedPass {
                        pass,
                        effect: effect.name,
                        needed_by,
                        reason: match other.map(|other| (other.wanted)(tables)) {
                            Some(Wanted::Yes(reason)) => reason,
                            _ => reason.clone(),
                        },
                    }
                })),
                Wanted::No(reason) => without.push(Omitted {
                    name: effect.name,
                    reason,
                }),
            }
        }
        let used: BTreeSet<&'static Buffer> = passes
            .iter()
            .flat_map(|planned| planned.pass.bindings)
            .map(|&(resource, _)| resource)
            .collect();
        let resources = used
            .into_iter()
            .map(|resource| PlannedResource {
                resource,
                bytes: resource.bytes(tables),
            })
            .collect();
        Self {
            passes,
            without,
            resources,
            warnings: REGISTRY.iter().flat_map(|effect| (effect.warnings)(tables)).collect(),
        }
    }

    /// Whether any pass binds a buffer.
    pub fn uses(&self, buffer: &Buffer) -> bool {
        self.resources.iter().any(|planned| planned.resource == buffer)
    }

    /// Whether the scene calls for an effect.
    pub fn has(&self, effect: &str) -> bool {
        let of_it = |planned: &PlannedPass| planned.effect == effect || planned.needed_by == Some(effect);
        self.passes.iter().any(of_it)
    }

    /// Passes with the buffers that are bound in a frame, some of which passes swap.
    pub fn bound(&self) -> Vec<Bound> {
        let mut flipped = false;
        let bind = |planned: &PlannedPass| {
            let pass = planned.pass;
            let buffers = pass.bindings.iter();
            let buffers = buffers
                .map(|&(buffer, how)| (buffers::bound(buffer, flipped), how))
                .collect();
            flipped ^= pass.flips;
            Bound { pass, buffers }
        };
        self.passes.iter().map(bind).collect()
    }

    /// Dispatches of a frame on a GPU that can bind `most_buffers` buffers to each.
    pub fn fused(&self, most_buffers: usize) -> Vec<Fused> {
        fuse(&self.bound(), most_buffers)
    }

    fn names(&self, fused: &Fused) -> Vec<&'static str> {
        let numbers = fused.iter().flat_map(|sequence| &sequence.passes);
        numbers.map(|&number| self.passes[number].pass.name).collect()
    }

    /// Bytes of all resources.
    pub fn bytes(&self) -> u64 {
        self.resources.iter().map(|planned| planned.bytes).sum()
    }

    /// Bands of rows such that no per-pixel resource of a band exceeds `binding_bytes`.
    pub fn bands(&self, tables: &Tables, binding_bytes: u64) -> Vec<Band> {
        let largest = self
            .resources
            .iter()
            .filter(|planned| planned.resource.is_per_pixel)
            .map(|planned| planned.bytes)
            .max();
        let per_row = largest.unwrap_or(0).div_ceil(tables.height() as u64).max(1);
        let rows = (binding_bytes / per_row).clamp(1, MAX_BAND_ROWS) as usize;
        (0..tables.height())
            .step_by(rows)
            .map(|first| Band {
                first_row: first as u32,
                rows: rows.min(tables.height() - first) as u32,
            })
            .collect()
    }

    /// The plan as plain data, for JSON. `origins` are those of the effects in the scene
    /// ([`Scene::origins`](crate::scene::Scene::origins)), empty for settings made in code.
    pub fn report(&self, origins: &Origins) -> PlanReport {
        let named = |planned: &PlannedPass| NamedPass {
            name: planned.pass.name,
            effect: planned.effect,
            origin: match (planned.needed_by, origins.get(planned.effect)) {
                (Some(other), _) => format!("needed by {other}"),
                (None, Some(Origin::Usual | Origin::Scanner)) => "usual".to_owned(),
                (None, _) => "named".to_owned(),
            },
            reason: planned.reason.clone(),
        };
        let left_out = |omitted: &Omitted| {
            let absence = origins
                .get(omitted.name)
                .and_then(|origin| origin.absence(omitted.name));
            Omitted {
                name: omitted.name,
                reason: absence.unwrap_or_else(|| omitted.reason.clone()),
            }
        };
        PlanReport {
            passes: self.passes.iter().map(named).collect(),
            scanner: origins
                .iter()
                .filter(|(_, origin)| **origin == Origin::Scanner)
                .map(|(effect, _)| *effect)
                .filter(|effect| self.has(effect))
                .collect(),
            dispatches: self.fused(MAX_BUFFERS).iter().map(|fused| self.names(fused)).collect(),
            without: self.without.iter().map(left_out).collect(),
            resources: self.resources.clone(),
            bytes: self.bytes(),
            warnings: self.warnings.clone(),
            quality: None,
        }
    }
}

/// Maximum number of workgroups along one dimension in WebGPU's default limits; a band has one per row.
const MAX_BAND_ROWS: u64 = 65_535;

/// A pass in a report.
#[derive(Clone, Debug, Serialize)]
pub struct NamedPass {
    /// Name of the pass.
    pub name: &'static str,
    /// Name of the effect that the pass belongs to.
    pub effect: &'static str,
    /// Origin: `usual`, `named`, or `needed by` something else.
    pub origin: String,
    /// Why the scene calls for it.
    pub reason: String,
}

/// A plan as plain data.
#[derive(Clone, Debug, Serialize)]
pub struct PlanReport {
    /// Passes in order of execution.
    pub passes: Vec<NamedPass>,
    /// Effects that the scanner adds to the usual ones.
    pub scanner: Vec<&'static str>,
    /// Passes that a GPU runs together, dispatch by dispatch.
    pub dispatches: Vec<Vec<&'static str>>,
    /// Effects that the scene does not use.
    pub without: Vec<Omitted>,
    /// Resources that the passes bind.
    pub resources: Vec<PlannedResource>,
    /// Bytes of all resources.
    pub bytes: u64,
    /// Deviations of the output from what the scene requests.
    pub warnings: Vec<String>,
    /// Settings picked for the frame time budget, if the scene states one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<Picked>,
}

impl fmt::Display for PlanReport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "Passes")?;
        for pass in &self.passes {
            writeln!(f, "  {:<21} {}: {}", pass.name, pass.origin, pass.reason)?;
        }
        if !self.scanner.is_empty() {
            writeln!(f, "Processing by the scanner, which `scanner = \"raw\"` leaves out")?;
            writeln!(f, "  {}", self.scanner.join(", "))?;
        }
        writeln!(f, "Dispatches on a GPU: passes that it runs together, in order")?;
        for (number, passes) in (1..).zip(&self.dispatches) {
            writeln!(f, "  {number:<21} {}", passes.join(", "))?;
        }
        writeln!(f, "Without")?;
        for omitted in &self.without {
            writeln!(f, "  {:<21} {}", omitted.name, omitted.reason)?;
        }
        writeln!(f, "Resources")?;
        for planned in &self.resources {
            writeln!(
                f,
                "  {:<21} {:>12} bytes",
                format!("{:?}", planned.resource),
                planned.bytes
            )?;
        }
        write!(f, "  {:<21} {:>12} bytes", "total", self.bytes)?;
        if let Some(picked) = &self.quality {
            writeln!(f, "\nPicked for {} = {}", picked.asked, picked.budget_ms)?;
            for setting in &picked.settings {
                writeln!(f, "  {:<21} {}", setting.key, setting.value)?;
            }
            write!(f, "  {}", picked.why)?;
        }
        Ok(())
    }
}
