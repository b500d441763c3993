//! Random scenes: anatomy, mesh, probe, pose, image and effects, all from a seed.

use nalgebra::{Matrix4, Rotation3, Translation3, Vector3};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::stability::fixtures::{Tally, gpus};
use crate::stability::record::{Record, Unexpected, noise};
use insonify_imaging::anatomies::{self, Acoustics, Frame, SILENT};
use insonify_imaging::effects::Effects;
use insonify_imaging::parity::{Case, check};
use insonify_imaging::synth::tables::{Anatomy, ImageSize, Settings};
use insonify_imaging::synth::{FrameState, NeedleShaft};
use insonify_mesh::Displacement;
use insonify_tracking::probe::{Probe, ProbeShape, ProbeSpec};

/// Random number stream of one scene.
struct Draw {
    seed: u64,
    drawn: u64,
}

impl Draw {
    /// Returns a number in [low, high).
    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.drawn += 1;
        low + (high - low) * (0.5 + 0.5 * noise(self.seed, self.drawn))
    }

    fn below(&mut self, count: usize) -> usize {
        (self.within(0.0, count as f64) as usize).min(count - 1)
    }

    fn chance(&mut self, share: f64) -> bool {
        self.within(0.0, 1.0) < share
    }

    fn point(&mut self, reach: f64) -> [f64; 3] {
        std::array::from_fn(|_| self.within(-reach, reach))
    }
}

/// Returns the scene with an index. Its mesh, if any, is not folded.
pub(super) fn scene(seed: u64, index: u64) -> Case {
    let mut draw = Draw {
        seed: seed ^ index.wrapping_mul(0x9e37_79b9_7f4a_7c15),
        drawn: 0,
    };
    let centre = draw.point(80.0);
    let anatomy = anatomy(&mut draw, centre);
    let probe = probe(&mut draw);
    let mut state = pose(&mut draw, centre);
    state.frame = draw.within(0.0, 1e6) as u64;
    let has_needle = draw.chance(0.5);
    if has_needle && draw.chance(0.9) {
        needle(&mut draw, &mut state);
    }
    let anatomy = if draw.chance(0.35) {
        deformed(&mut draw, anatomy, centre, &mut state)
    } else {
        anatomy
    };
    let effects = effects(&mut draw);
    let settings = Settings {
        seed: draw.within(0.0, u64::MAX as f64) as u64,
        probe,
        image: ImageSize {
            width: 8 + draw.below(90),
            height: 8 + draw.below(70),
            margin: draw.within(0.0, 0.2),
            fill: draw.below(256) as u8,
            placed: None,
        },
        effects,
        has_needle,
        layers: Vec::new(),
    };
    Case::new(format!("scene {index}"), anatomy, settings, state)
}

fn anatomy(draw: &mut Draw, centre: [f64; 3]) -> Anatomy {
    let textured = draw.chance(0.6);
    let mut tissues = vec![SILENT];
    for _ in 0..2 + draw.below(4) {
        tissues.push(Acoustics {
            echo_db: draw.within(-20.0, 10.0),
            attenuation_db_cm_mhz: draw.within(0.0, 2.0),
            occlusion_per_mm: if draw.chance(0.3) { draw.within(0.0, 0.95) } else { 0.0 },
            impedance_mrayl: draw.within(1.4, 4.0),
            texture: (textured && draw.chance(0.5)).then_some("hashed"),
        });
    }
    let size = std::array::from_fn(|_| 24 + draw.below(17));
    let mut frame = Frame::around(centre, size, draw.within(0.8, 1.3));
    if draw.chance(0.5) {
        frame = frame.oblique();
    }
    let mut anatomy = match draw.below(3) {
        0 => anatomies::random(frame, &tissues, draw.below(1 << 20) as u32),
        1 => anatomies::ball(frame, centre, draw.within(5.0, 12.0), &tissues[..3]),
        _ => {
            let top = centre[1] - 12.0;
            let depths: Vec<f64> = (1..tissues.len())
                .map(|index| top + draw.within(0.0, 6.0) + 5.0 * index as f64)
                .collect();
            anatomies::layers(frame, &depths, &tissues)
        }
    };
    anatomy.textures.insert("hashed".into(), anatomies::hashed_texture());
    anatomy
}

/// Draws a probe of any kind, with numbers near those of the kind's example.
fn probe(draw: &mut Draw) -> Probe {
    let (_, shape) = ProbeShape::EXAMPLES[draw.below(ProbeShape::EXAMPLES.len())];
    let default_probe = Probe {
        shape,
        depth_mm: draw.within(20.0, 50.0),
        frequency_mhz: draw.within(2.0, 12.0),
        lines: 4 + draw.below(28) as u32,
        samples: 24 + draw.below(120) as u32,
        aperture: Default::default(),
    };
    let valid = (0..MAX_DRAWS).find_map(|_| {
        let numbers = shape.numbers().into_iter();
        let shape = numbers
            .map(|(key, number)| (key, number * draw.within(0.4, 1.6)))
            .collect();
        Probe::try_from(ProbeSpec {
            shape,
            ..default_probe.into()
        })
        .ok()
    });
    valid.unwrap_or(default_probe)
}

/// Draws a pose at the rim of the volume that looks towards its middle, with a random roll.
fn pose(draw: &mut Draw, centre: [f64; 3]) -> FrameState {
    let middle = Vector3::from(centre);
    let outward = Vector3::from(draw.point(1.0));
    let outward = outward.try_normalize(1e-3).unwrap_or(-Vector3::y());
    let origin = middle + outward * draw.within(5.0, 22.0);
    let axis = (middle + Vector3::from(draw.point(4.0)) - origin).normalize();
    let swing = Rotation3::rotation_between(&Vector3::y(), &axis).unwrap_or_else(Rotation3::identity);
    let turn = swing * Rotation3::from_axis_angle(&Vector3::y_axis(), draw.within(-3.0, 3.0));
    FrameState::at(Translation3::from(origin).to_homogeneous() * turn.to_homogeneous())
}

/// Adds a shaft of two to five nodes near the plane, and sometimes seeds.
fn needle(draw: &mut Draw, state: &mut FrameState) {
    let pose: Matrix4<f64> = state.probe_to_world;
    let mut node = Vector3::new(draw.within(-20.0, -8.0), draw.within(2.0, 10.0), draw.within(-1.0, 1.0));
    let mut nodes = vec![pose.transform_point(&node.into())];
    for _ in 0..1 + draw.below(4) {
        node += Vector3::new(draw.within(2.0, 9.0), draw.within(2.0, 9.0), draw.within(-0.8, 0.8));
        nodes.push(pose.transform_point(&node.into()));
    }
    state.needle = Some(NeedleShaft {
        nodes,
        diameter_mm: draw.within(0.5, 2.0),
    });
    for _ in 0..draw.below(4) {
        let centre = [draw.within(-8.0, 8.0), draw.within(6.0, 26.0), draw.within(-0.5, 0.5)];
        let axis = pose.transform_vector(
            &Vector3::from(draw.point(1.0))
                .try_normalize(1e-3)
                .unwrap_or(Vector3::x()),
        );
        state
            .seeds
            .push(NeedleShaft::seed(pose.transform_point(&centre.into()), &axis));
    }
}

/// Adds a mesh over the middle, compressed and swirled without folding.
fn deformed(draw: &mut Draw, anatomy: Anatomy, centre: [f64; 3], state: &mut FrameState) -> Anatomy {
    let half: [f64; 3] = std::array::from_fn(|_| draw.within(9.0, 14.0));
    let bounds = [-1.0, 1.0].map(|side| std::array::from_fn(|axis| centre[axis] + side * half[axis]));
    let anatomy = anatomies::with_mesh(anatomy, bounds, 60 + draw.below(140));
    let Some(mesh) = anatomy.mesh.clone() else {
        return anatomy;
    };
    let radius_mm = draw.within(6.0, 10.0);
    let mut press = Displacement::Indentation {
        centre_mm: std::array::from_fn(|axis| centre[axis] + 0.5 * half[axis]),
        direction: [-0.2, -1.0, 0.1],
        depth_mm: draw.within(1.0, 4.0),
        radius_mm,
    };
    let mut swirl = Displacement::Swirl {
        centre_mm: centre,
        axis: [0.3, 0.2, 1.0],
        angle_deg: draw.within(-15.0, 15.0),
        radius_mm,
    };
    loop {
        let moved_node = |&node: &[f64; 3]| -> [f64; 3] {
            (Vector3::from(node) + Vector3::from(press.apply(node)) + Vector3::from(swirl.apply(node))).into()
        };
        let nodes: Vec<[f64; 3]> = mesh.nodes().iter().map(moved_node).collect();
        let volumes = mesh.volumes(mesh.nodes());
        // Elements keep a tenth of their volume: folded meshes are a separate case.
        if volumes
            .zip(mesh.volumes(&nodes))
            .all(|(before, after)| after > 0.1 * before)
        {
            state.nodes = Some(nodes);
            return anatomy;
        }
        if let Displacement::Indentation { depth_mm, .. } = &mut press {
            *depth_mm *= 0.5;
        }
        if let Displacement::Swirl { angle_deg, .. } = &mut swirl {
            *angle_deg *= 0.5;
        }
    }
}

/// Draws the effects of a scene, and their parameters from the ranges that the JSON schema states. What an effect does
/// not accept is drawn again.
fn effects(draw: &mut Draw) -> Effects {
    let schema = schemars::schema_for!(Effects).to_value();
    let mut drawn = Map::new();
    for (name, described) in schema["properties"].as_object().into_iter().flatten() {
        // An effect that can be off is that, or its parameters.
        let table = match described.get("anyOf") {
            Some(_) if draw.chance(0.4) => continue,
            Some(either) => &either[0],
            None => described,
        };
        let valid = (0..MAX_DRAWS).find_map(|_| {
            let table = parameters(draw, &schema, resolved(&schema, table));
            let alone = Effects::deserialize(json!({ name: table })).ok()?;
            alone.validate().is_ok().then_some(table)
        });
        drawn.extend(valid.map(|table| (name.clone(), table)));
    }
    Effects::deserialize(Value::from(drawn)).unwrap_or_default()
}

/// Most draws of an effect or a probe until its parameters fit together.
const MAX_DRAWS: usize = 100;

/// Follows the reference of a node of a schema.
fn resolved<'a>(schema: &'a Value, node: &'a Value) -> &'a Value {
    let definition = node["$ref"]
        .as_str()
        .and_then(|pointer| schema.pointer(pointer.trim_start_matches('#')));
    definition.unwrap_or(node)
}

/// Draws the parameters of a table; those that are neither numbers nor choices keep their defaults.
fn parameters(draw: &mut Draw, schema: &Value, table: &Value) -> Value {
    let mut drawn = Map::new();
    for (key, described) in table["properties"].as_object().into_iter().flatten() {
        let is_type = |name: &str| described["type"] == name || described["type"][0] == name;
        let choices = resolved(schema, described)["oneOf"].as_array();
        let value = match choices {
            Some(choices) => choices[draw.below(choices.len())]["const"].clone(),
            None if is_type("boolean") => draw.chance(0.7).into(),
            None if described["type"].is_array() && draw.chance(0.4) => continue,
            None if is_type("integer") => (number(draw, described).round() as u64).into(),
            None if is_type("number") => number(draw, described).into(),
            None => continue,
        };
        drawn.insert(key.clone(), value);
    }
    drawn.into()
}

/// Draws a number: an end of its range, or one between its default, or the low end without one, and an end, more often
/// near the default.
fn number(draw: &mut Draw, described: &Value) -> f64 {
    let figure = |name: &str| described[name].as_f64();
    let (low, high) = (figure("minimum").unwrap_or(0.0), figure("maximum").unwrap_or(1.0));
    let default = figure("default").unwrap_or(low);
    let end = if draw.chance(0.5) { low } else { high };
    let share = if draw.chance(0.1) {
        1.0
    } else {
        draw.within(0.0, 1.0).powi(3)
    };
    default + share * (end - default)
}

/// Compares all backends on randomly drawn scenes.
pub(super) fn scenes(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let count = record.effort().pick(10, 100);
    let mut tally = Tally::default();
    for index in 0..count {
        let case = scene(record.seed(), index);
        let verdicts = check(&case, &gpus)?;
        tally.add(&case, verdicts);
        record.done((index + 1) as f64 / count as f64);
    }
    record.report("scenes", count as f64);
    tally.note(record)
}
