//! Saved states of the mass-spring model: all numbers by their bits, so that a round trip through text changes nothing.

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::MassSpring;
use super::body::{Body, BoneContact, TipNode};
use super::contacts::Contact;
use crate::insertion::{Bone, Event, EventKind, Outcome, Saved, StepError, Wrench};
use crate::needle::{CentreLine, Entry};

const EVENTS: [EventKind; 10] = [
    EventKind::Skin,
    EventKind::Puncture,
    EventKind::Region,
    EventKind::Bone,
    EventKind::Out,
    EventKind::Seed,
    EventKind::NotRemeshed,
    EventKind::NotConverged,
    EventKind::Crushed,
    EventKind::Critical,
];

impl MassSpring {
    fn model(&self) -> String {
        format!("mass-spring, {:?}, {:?}", self.parameters, self.needle)
    }

    pub(super) fn to_saved(&self) -> Saved {
        let mut words = Words::default();
        put_body(&mut words, &self.body);
        put_outcome(&mut words, &self.outcome);
        words.list(&self.contacts.stack, |to, contact| {
            to.integer(contact.node.into());
            to.real(contact.arc);
            to.flag(contact.stuck);
            to.region(contact.region);
            to.optional(contact.beyond, |to, (from, region)| {
                to.real(from);
                to.region(region);
            });
            to.vector(&contact.force);
            to.vector(&contact.side);
        });
        words.pose(&self.frame);
        let moved: Vec<usize> = (0..self.network.original.len())
            .filter(|&node| self.network.reference[node] != self.network.original[node])
            .collect();
        words.list(&moved, |to, &node| {
            to.integer(node as u64);
            to.vector(&self.network.reference[node]);
        });
        if self.body.active {
            words.list(&self.network.displacement, |to, vector| to.vector(vector));
            words.list(&self.network.velocity, |to, vector| to.vector(vector));
        }
        let document = Document {
            model: self.model(),
            words: words.0,
        };
        Saved(serde_json::json!({ "model": document.model, "words": document.words }))
    }

    pub(super) fn take_saved(&mut self, saved: &Saved) -> Result<(), StepError> {
        let document: Document =
            serde::Deserialize::deserialize(&saved.0).map_err(|error| StepError::Foreign(error.to_string()))?;
        let own = self.model();
        if document.model != own {
            let found = document.model;
            return Err(StepError::Foreign(format!("found `{found}`; expected `{own}`")));
        }
        self.read(&document.words).map_err(StepError::Foreign)
    }

    fn read(&mut self, words: &[u64]) -> Result<(), String> {
        let count = self.network.original.len();
        let from = &mut Reader(words);
        let body = get_body(from, self.network.elements.len())?;
        let outcome = get_outcome(from)?;
        let stack = from.list(|from| {
            Ok(Contact {
                node: from.below(count, "a node")?,
                arc: from.real()?,
                stuck: from.flag()?,
                region: from.region()?,
                beyond: from.optional(|from| Ok((from.real()?, from.region()?)))?,
                force: from.vector()?,
                side: from.vector()?,
            })
        })?;
        let frame = from.pose()?;
        let moved = from.list(|from| Ok((from.below(count, "a node")?, from.vector()?)))?;
        let mut fields = [const { Vec::<Vector3<f64>>::new() }; 2];
        if body.active {
            for field in &mut fields {
                *field = from.list(Reader::vector)?;
                if field.len() != count {
                    return Err(format!("it holds {} vectors for {count} nodes", field.len()));
                }
            }
        }
        from.end()?;
        self.frame = frame;
        self.network.place(&frame);
        for (node, reference) in moved {
            self.network.reference[node as usize] = reference;
        }
        self.network.measure_all();
        if body.active {
            self.network.displacement.copy_from_slice(&fields[0]);
            self.network.velocity.copy_from_slice(&fields[1]);
        }
        self.contacts.stack.clear();
        self.contacts.stack.extend(stack);
        self.body = body;
        self.outcome = outcome;
        Ok(())
    }
}

fn put_body(to: &mut Words, body: &Body) {
    to.integer(body.step);
    to.real(body.time_s);
    to.optional(body.base, |to, pose| to.pose(&pose));
    to.list(body.line.nodes(), |to, (arc, point)| {
        to.real(*arc);
        to.vector(&point.coords);
    });
    to.list(body.line.turns(), Words::vector);
    to.optional(body.entry, |to, entry| {
        to.vector(&entry.point_mm.coords);
        to.vector(&entry.direction);
    });
    to.integer(body.tip_node as u64);
    to.flag(body.breaking);
    to.region(body.region);
    to.vector(&body.crossed);
    to.integer(body.element.into());
    to.flag(body.refused);
    to.optional(body.bone_contact, |to, bone_contact| {
        to.vector(&bone_contact.at.coords);
        to.vector(&bone_contact.direction);
        to.real(bone_contact.bone.stiffness_n_per_mm);
        to.real(bone_contact.bone.penetration_mm);
    });
    to.flag(body.active);
    to.list(&body.seeds, |to, seed| to.vector(&seed.coords));
}

fn get_body(from: &mut Reader, elements: usize) -> Result<Body, String> {
    let (step, time_s) = (from.integer()?, from.real()?);
    let base = from.optional(Reader::pose)?;
    let nodes = from.list(|from| Ok((from.real()?, from.point()?)))?;
    let turns = from.list(Reader::vector)?;
    if nodes.len() == 1 || nodes.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
        return Err("the needle's arcs do not rise".into());
    }
    let mut line = CentreLine::default();
    if !nodes.is_empty() {
        line.set_turned(nodes, &turns);
    }
    let entry = from.optional(|from| {
        Ok(Entry {
            point_mm: from.point()?,
            direction: from.direction()?,
        })
    })?;
    let tip_node = [TipNode::Held, TipNode::Penetrated, TipNode::Empty][from.below(3, "a kind of tip node")? as usize];
    Ok(Body {
        step,
        time_s,
        base,
        line,
        entry,
        tip_node,
        breaking: from.flag()?,
        region: from.region()?,
        crossed: from.vector()?,
        element: from.below(elements, "an element")?,
        refused: from.flag()?,
        bone_contact: from.optional(|from| {
            Ok(BoneContact {
                at: from.point()?,
                direction: from.direction()?,
                bone: Bone {
                    stiffness_n_per_mm: from.real()?,
                    penetration_mm: from.real()?,
                },
            })
        })?,
        active: from.flag()?,
        seeds: from.list(Reader::point)?,
    })
}

fn put_outcome(to: &mut Words, outcome: &Outcome) {
    to.vector(&outcome.on_hand.force_n);
    to.vector(&outcome.on_hand.torque_nmm);
    to.vector(&outcome.tip_mm.coords);
    to.real(outcome.tip_deflection_mm);
    to.real(outcome.inserted_mm);
    for count in counts(outcome) {
        to.integer(count as u64);
    }
    to.flag(outcome.converged);
    to.list(&outcome.events, |to, event| {
        let kind = EVENTS.iter().position(|&kind| kind == event.kind);
        to.integer(kind.unwrap_or(EVENTS.len()) as u64);
        to.real(event.time_s);
        to.vector(&event.at_mm.coords);
        to.region(event.region);
    });
}

/// Returns the counts of an outcome that this model sets.
fn counts(outcome: &Outcome) -> [usize; 6] {
    [
        outcome.contacts,
        outcome.stuck,
        outcome.remeshes,
        outcome.substeps,
        outcome.iterations,
        outcome.crushed,
    ]
}

fn get_outcome(from: &mut Reader) -> Result<Outcome, String> {
    let on_hand = Wrench {
        force_n: from.vector()?,
        torque_nmm: from.vector()?,
    };
    let (tip_mm, tip_deflection_mm, inserted_mm) = (from.point()?, from.real()?, from.real()?);
    let mut counts = [0; 6];
    for count in &mut counts {
        *count = from.integer()? as usize;
    }
    let [contacts, stuck, remeshes, substeps, iterations, crushed] = counts;
    Ok(Outcome {
        on_hand,
        tip_mm,
        tip_deflection_mm,
        inserted_mm,
        contacts,
        stuck,
        remeshes,
        substeps,
        iterations,
        crushed,
        converged: from.flag()?,
        events: from.list(|from| {
            Ok(Event {
                kind: EVENTS[from.below(EVENTS.len(), "an event")? as usize],
                time_s: from.real()?,
                at_mm: from.point()?,
                region: from.region()?,
            })
        })?,
        ..Outcome::default()
    })
}

/// A saved model.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    /// Identity of the model: its parameters and its needle as text.
    model: String,
    /// State, in the order in which the [`Words`] were written.
    words: Vec<u64>,
}

/// Encoder of numbers, one after another.
#[derive(Default)]
struct Words(Vec<u64>);

impl Words {
    fn integer(&mut self, number: u64) {
        self.0.push(number);
    }

    fn flag(&mut self, flag: bool) {
        self.0.push(flag.into());
    }

    fn real(&mut self, number: f64) {
        self.0.push(number.to_bits());
    }

    fn vector(&mut self, vector: &Vector3<f64>) {
        vector.iter().for_each(|&number| self.real(number));
    }

    fn pose(&mut self, pose: &Isometry3<f64>) {
        self.vector(&pose.translation.vector);
        pose.rotation.coords.iter().for_each(|&number| self.real(number));
    }

    fn optional<T>(&mut self, value: Option<T>, put: impl FnOnce(&mut Words, T)) {
        self.flag(value.is_some());
        if let Some(value) = value {
            put(self, value);
        }
    }

    fn list<T>(&mut self, items: &[T], put: impl Fn(&mut Words, &T)) {
        self.integer(items.len() as u64);
        items.iter().for_each(|item| put(self, item));
    }

    fn region(&mut self, region: Option<i32>) {
        self.optional(region, |to, region| to.integer(region as u32 as u64));
    }
}

/// Decoder of [`Words`]. What does not fit is an error with the expectation.
struct Reader<'a>(&'a [u64]);

impl Reader<'_> {
    fn integer(&mut self) -> Result<u64, String> {
        let (first, rest) = self.0.split_first().ok_or("it ends too early")?;
        self.0 = rest;
        Ok(*first)
    }

    /// Reads a number below a limit.
    fn below(&mut self, limit: usize, what: &str) -> Result<u32, String> {
        let found = self.integer()?;
        match found < limit as u64 {
            true => Ok(found as u32),
            false => Err(format!("{what} is {found}; expected one below {limit}")),
        }
    }

    fn flag(&mut self) -> Result<bool, String> {
        Ok(self.below(2, "a flag")? == 1)
    }

    /// Reads a finite number.
    fn real(&mut self) -> Result<f64, String> {
        let found = f64::from_bits(self.integer()?);
        match found.is_finite() {
            true => Ok(found),
            false => Err(format!("a number is {found}; expected a finite one")),
        }
    }

    fn vector(&mut self) -> Result<Vector3<f64>, String> {
        Ok(Vector3::new(self.real()?, self.real()?, self.real()?))
    }

    fn point(&mut self) -> Result<Point3<f64>, String> {
        self.vector().map(Point3::from)
    }

    fn direction(&mut self) -> Result<Unit<Vector3<f64>>, String> {
        self.vector().map(Unit::new_unchecked)
    }

    fn pose(&mut self) -> Result<Isometry3<f64>, String> {
        let translation = Translation3::from(self.vector()?);
        let [i, j, k, w] = [self.real()?, self.real()?, self.real()?, self.real()?];
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
        Ok(Isometry3::from_parts(translation, rotation))
    }

    fn optional<T>(&mut self, get: impl FnOnce(&mut Self) -> Result<T, String>) -> Result<Option<T>, String> {
        match self.flag()? {
            true => get(self).map(Some),
            false => Ok(None),
        }
    }

    fn list<T>(&mut self, get: impl Fn(&mut Self) -> Result<T, String>) -> Result<Vec<T>, String> {
        let count = self.below(self.0.len() + 1, "a length")?;
        (0..count).map(|_| get(self)).collect()
    }

    fn region(&mut self) -> Result<Option<i32>, String> {
        self.optional(|from| Ok(from.below(1 << 32, "a region")? as i32))
    }

    /// Checks that nothing is left.
    fn end(&self) -> Result<(), String> {
        match self.0.len() {
            0 => Ok(()),
            more => Err(format!("it holds {more} numbers too many")),
        }
    }
}
