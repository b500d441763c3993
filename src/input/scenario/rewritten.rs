//! The text of a scenario with another path of its needle. Keys that this does not concern stay as the text states
//! them.

use toml::{Table, Value};

use super::plan::TargetSpec;
use insonify_imaging::scene::NeedleKeyframe;

/// The text of a scenario, to be written again.
#[derive(Clone, Debug)]
pub struct ScenarioText(Table);

impl ScenarioText {
    /// Reads the text of a scenario.
    ///
    /// # Errors
    /// The reason if it is not TOML.
    pub fn parse(text: &str) -> Result<Self, String> {
        text.parse()
            .map(Self)
            .map_err(|error: toml::de::Error| error.to_string())
    }

    /// Moves the needle by these keyframes, in place of whatever moves it, to one target in place of all others.
    ///
    /// # Errors
    /// The reason if `needle`, `run` or `plan` is no table.
    pub fn with_needle_path(mut self, keyframes: &[NeedleKeyframe], target: &TargetSpec) -> Result<Self, String> {
        let needle = self.table("needle")?;
        // The keyframes are in the world, whatever those before were in.
        for mover in ["target", "entry", "deposit_s", "frame"] {
            needle.remove(mover);
        }
        let mut motion = Table::new();
        motion.insert("keyframes".to_owned(), value(&keyframes)?);
        needle.insert("motion".to_owned(), motion.into());
        if let Some(Value::Table(guide)) = self.0.get_mut("manipulator") {
            guide.remove("keyframes");
        }
        // Each motion has its own length.
        self.table("run")?.remove("duration_s");
        let plan = self.table("plan")?;
        plan.remove("needle");
        plan.remove("template");
        let mut only = value(target)?;
        if let (Some(table), true) = (only.as_table_mut(), target.radius_mm == 0.0) {
            table.remove("radius_mm");
        }
        plan.insert("target".to_owned(), Value::Array(vec![only]));
        Ok(self)
    }

    /// Holds the probe at a place (mm) with the direction of its beam and that to its marked side.
    ///
    /// # Errors
    /// The reason if `scene` is no table.
    pub fn with_probe(mut self, [position_mm, direction, lateral]: [[f64; 3]; 3]) -> Result<Self, String> {
        let scene = self.table("scene")?;
        scene.remove("motion");
        let mut pose = Table::new();
        for (key, numbers) in [
            ("position_mm", position_mm),
            ("direction", direction),
            ("lateral", lateral),
        ] {
            pose.insert(key.to_owned(), value(&numbers)?);
        }
        scene.insert("pose".to_owned(), pose.into());
        Ok(self)
    }

    /// Meshes this part of the volume (mm), unless the text states one itself, and states whether elements are finer
    /// along the path.
    ///
    /// # Errors
    /// The reason if `tissue` is no table.
    pub fn with_mesh(mut self, box_mm: Option<[[f64; 3]; 2]>, along_path: Option<bool>) -> Result<Self, String> {
        let tissue = self.table("tissue")?;
        if let Some(corners) = box_mm {
            tissue.entry("box_mm").or_insert(value(&corners)?);
        }
        if let Some(along_path) = along_path {
            tissue.insert("along_path".to_owned(), along_path.into());
        }
        Ok(self)
    }

    /// The text.
    ///
    /// # Errors
    /// The reason if a value has no form in TOML.
    pub fn text(&self) -> Result<String, String> {
        toml::to_string(&self.0).map_err(|error| error.to_string())
    }

    /// A table of the text, empty if it has none.
    fn table(&mut self, key: &str) -> Result<&mut Table, String> {
        match self.0.entry(key).or_insert_with(|| Table::new().into()) {
            Value::Table(table) => Ok(table),
            _ => Err(format!(
                "`{key}` names a file; expected a table, in which the task places probe and needle"
            )),
        }
    }
}

fn value(part: &impl serde::Serialize) -> Result<Value, String> {
    Value::try_from(part).map_err(|error| error.to_string())
}
