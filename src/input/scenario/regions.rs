//! Names and materials of mesh regions.

use insonify_anatomy::acoustics::RIGID_KPA;
use std::collections::BTreeMap;

use super::file::ScenarioFile;
use super::tissue::{MaterialSpec, TissueModel};
use crate::input::material::TableOfRegion;
use insonify_anatomy::acoustics::Tissue;
use insonify_anatomy::volume::LabelVolume;
use insonify_base::document::{InputError, Names, RegionName};
use insonify_imaging::scene::{Body, Scene};
use insonify_mechanics::insertion::{Bone, Interaction};
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::material::Material;

/// Default bone contact, felt as a stop: the force grows to 20 N within 0.5 mm and stays there, more than haptic
/// devices render.
const BONE: Bone = Bone {
    stiffness_n_per_mm: 40.0,
    penetration_mm: 0.5,
};

/// Regions that a scenario can refer to: labels of its scene.
pub(crate) struct Regions<'a> {
    file: &'a ScenarioFile,
    scene: &'a Scene,
    /// Region names from a mesh file.
    named: &'a BTreeMap<i32, String>,
    /// Help for a region that is not there.
    hint: Option<&'a str>,
}

/// Properties of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Region {
    pub material: Material,
    /// The law of the material, which at small strain is `material`.
    pub law: AnyLaw,
    pub interaction: Interaction,
    pub rigid: bool,
}

impl<'a> Regions<'a> {
    pub(crate) fn new(file: &'a ScenarioFile, scene: &'a Scene, named: &'a BTreeMap<i32, String>) -> Self {
        Self {
            file,
            scene,
            named,
            hint: None,
        }
    }

    /// Sets the help for a region that is not there: the cell arrays of a mesh file that could give the regions.
    pub(crate) fn with_hint(self, hint: Option<&'a str>) -> Self {
        Self { hint, ..self }
    }

    /// Volume whose labels are the regions.
    pub(crate) fn volume(&self) -> &LabelVolume {
        self.scene.anatomy.volume.undivided()
    }

    fn body(&self) -> Body<'_> {
        self.scene.body()
    }

    /// Label index whose value is the number of a region.
    fn label(&self, region: i32) -> Option<u8> {
        let labels = self.scene.anatomy.volume.labels();
        let index = labels.iter().position(|label| label.value == i64::from(region))?;
        u8::try_from(index).ok()
    }

    fn tissue(&self, region: i32) -> Option<&Tissue> {
        self.label(region).map(|label| self.scene.anatomy.tissues.tissue(label))
    }

    /// Name of a region.
    pub(crate) fn name(&self, region: i32) -> String {
        let in_mesh_file = self.named.get(&region).cloned();
        in_mesh_file
            .or_else(|| self.label(region).map(|label| self.body().name(label)))
            .unwrap_or_else(|| region.to_string())
    }

    /// Numbers of the regions that match a name.
    pub(crate) fn numbers(&self, key: &str, name: &RegionName) -> Result<Vec<i32>, InputError> {
        let labels = self.body().entries().into_iter();
        let of_labels = labels.filter_map(|(_, value, names)| Some((i32::try_from(value).ok()?, value, names)));
        let of_mesh = self.named.iter();
        let of_mesh = of_mesh.map(|(region, name)| (*region, i64::from(*region), vec![name.clone()]));
        let known = Names::new(of_labels.chain(of_mesh));
        known.find(name).map_err(|error| {
            let help = error.help().or_else(|| self.hint.map(str::to_owned));
            self.file.fault(key, error).with_help(help)
        })
    }

    /// Properties of each of `regions`.
    pub(crate) fn properties(&self, regions: &[i32]) -> Result<BTreeMap<i32, Region>, InputError> {
        let specs = &self.file.tissue.material;
        for (index, spec) in specs.iter().enumerate() {
            self.check(&format!("tissue.material[{index}]"), spec)?;
        }
        let tables = TableOfRegion::new(
            "tissue.material",
            specs.iter().map(|spec| spec.region.as_ref()),
            |key, name| self.numbers(key, name),
            |region| format!("region {region} ({})", self.name(region)),
            |key, found, expected| self.file.wrong_keys(key, found, expected),
        )?;
        let properties = |&region: &i32| Ok((region, self.region(region, tables.of(region))?));
        regions.iter().map(properties).collect()
    }

    /// Checks the values of a material table, independent of its region.
    fn check(&self, table: &str, spec: &MaterialSpec) -> Result<(), InputError> {
        self.file.in_ranges(&format!("{table}.peak"), spec.peak.as_ref())?;
        self.file.in_ranges(&format!("{table}.bone"), spec.bone.as_ref())?;
        let young = spec.young_kpa.or(spec.shear_kpa.is_none().then_some(1.0));
        let material = Material::from_modulus(young, spec.shear_kpa, spec.poisson.unwrap_or(0.0));
        let material = material.map_err(|error| self.file.fault(format!("{table}.{}", error.key), error))?;
        self.law(table, spec, material)?;
        self.file.in_ranges(table, spec)
    }

    fn law(&self, table: &str, spec: &MaterialSpec, material: Material) -> Result<AnyLaw, InputError> {
        let law = spec.law_of(material, self.file.tissue.model == TissueModel::Viscoelastic);
        law.map_err(|error| self.file.fault(format!("{table}.{}", error.key), error))
    }

    /// Properties of a region by the table at an index, if it has one, and by its tissue.
    fn region(&self, region: i32, index: Option<usize>) -> Result<Region, InputError> {
        let unstated = MaterialSpec::default();
        let spec = index.map_or(&unstated, |index| &self.file.tissue.material[index]);
        let table = index.map_or("tissue.material".to_owned(), |index| {
            format!("tissue.material[{index}]")
        });
        let tissue = self.tissue(region);
        let number = |given: Option<f64>, usual: fn(&Tissue) -> f64, key: &str| {
            given.or(tissue.map(usual)).ok_or_else(|| {
                let found = format!("no `{key}` for region {region}, which is no label of the scene");
                self.file
                    .wrong_keys(&table, found, "a `[[tissue.material]]` that states it")
                    .with_help(self.hint.map(str::to_owned))
            })
        };
        // Beside a stated shear modulus, Young's modulus of the tissue would be one too many.
        let young = match spec.shear_kpa {
            Some(_) => spec.young_kpa,
            None => Some(number(spec.young_kpa, |tissue| tissue.young_kpa, "young_kpa")?),
        };
        let poisson = number(spec.poisson, |tissue| tissue.poisson, "poisson")?;
        let material = Material::from_modulus(young, spec.shear_kpa, poisson)
            .map_err(|error| self.file.fault(format!("{table}.{}", error.key), error))?;
        let rigid = spec.rigid.unwrap_or(material.young_kpa() >= RIGID_KPA);
        let usual = Interaction {
            friction_n_per_mm: tissue.map_or(0.0, |tissue| tissue.friction_n_per_mm),
            cutting_n: tissue.map_or(0.0, |tissue| tissue.cutting_n),
            bone: rigid.then_some(BONE),
            ..Interaction::default()
        };
        Ok(Region {
            law: self.law(&table, spec, material)?,
            material,
            interaction: spec.interaction(&usual),
            rigid,
        })
    }
}
