//! Change of the remeshing level while the needle is in the tissue.

use std::time::Instant;

use nalgebra::Vector3;

use super::setup::{dense, source};
use super::{Finite, InvalidSetup};
use crate::mechanics::insertion::LevelChange;
use crate::mechanics::tissue::remesh::Level;

impl Finite {
    /// Changes the level. The needle settles at the pose of the last step before and after, so that the forces differ by the
    /// level alone.
    pub(super) fn change_level(&mut self, level: Level) -> Result<LevelChange, InvalidSetup> {
        let start = Instant::now();
        if level != Level::Exact && self.dense.is_none() {
            self.dense = Some(dense(&self.factor, self.precision, |_, _| {})?);
        }
        let from = self.adaptation.remesher().level();
        let before = self.rest();
        let condensed = self.adaptation.remesher().condensed().to_owned();
        if (level == Level::Exact) == (from == Level::Exact) {
            self.adaptation.ask(|mesh, remesher| remesher.set_level(mesh, level))?;
        } else {
            let (source, precision) = source(level, self.dense.as_ref(), &self.factor, &self.options);
            self.adaptation.switch_source(level, precision, source)?;
        }
        self.take_anew();
        let now = self.adaptation.remesher().condensed();
        let largest = condensed.norm_max();
        Ok(LevelChange {
            from,
            to: level,
            compliance_change: if largest > 0.0 {
                (now - &condensed).norm_max() / largest
            } else {
                0.0
            },
            force_jump_n: (self.rest() - before).norm(),
            seconds: start.elapsed().as_secs_f64(),
        })
    }

    /// Settles at the pose of the last step and returns the force on the hand there, N.
    fn rest(&mut self) -> Vector3<f64> {
        let Some(base) = self.base.filter(|_| self.steps > 0) else {
            return Vector3::zeros();
        };
        self.memory.starts.clear();
        self.memory
            .starts
            .extend(self.contacts.iter().map(|contact| contact.arc));
        self.settle(&base);
        let probe = self.press.as_ref().and_then(|press| press.pose);
        self.conclude(&base, probe.as_ref());
        self.outcome.on_hand.force_n
    }
}
