//! Tables of measured moduli and creep.

use std::path::Path;

use insonify_base::csv::{Csv, CsvError, Row};

/// Relative difference of stresses of one creep test.
const SAME_STRESS: f64 = 0.01;

/// Units of a column: names with their factors.
type Units<'a> = &'a [(&'static str, f64)];

const FREQUENCY: Units<'static> = &[("frequency_rad_s", 1.0), ("frequency_hz", std::f64::consts::TAU)];
const STORAGE: Units<'static> = &[("storage_kpa", 1.0), ("storage_pa", 1e-3)];
const LOSS: Units<'static> = &[("loss_kpa", 1.0), ("loss_pa", 1e-3)];
const STRESS: Units<'static> = &[("stress_kpa", 1.0), ("stress_pa", 1e-3)];
const TIME: Units<'static> = &[("time_s", 1.0), ("time_min", 60.0)];
const STRAIN: Units<'static> = &[("strain", 1.0), ("strain_percent", 0.01)];

/// Columns of a table, in words.
const EXPECTED: &str = "the columns frequency_rad_s (or frequency_hz), storage_kpa and loss_kpa (or _pa) of a frequency sweep, or stress_kpa (or \
                        stress_pa), time_s (or time_min) and strain (or strain_percent) of creep tests";

/// Storage and loss modulus at a frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modulus {
    /// Angular frequency, rad/s.
    pub frequency_rad_s: f64,
    /// Storage modulus G', kPa.
    pub storage_kpa: f64,
    /// Loss modulus G'', kPa.
    pub loss_kpa: f64,
}

/// Strain under a constant shear stress from time 0 on.
#[derive(Clone, Debug, PartialEq)]
pub struct CreepTest {
    /// Shear stress, kPa.
    pub stress_kpa: f64,
    /// Times after the start (s, ascending) with their shear strains.
    pub rows: Vec<[f64; 2]>,
}

/// Measurements of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurements {
    /// Frequency sweep.
    pub moduli: Vec<Modulus>,
    /// Creep tests.
    pub creep: Vec<CreepTest>,
}

impl Measurements {
    /// Adds the measurements in a CSV file. Its header says what they are; other columns are ignored.
    ///
    /// # Errors
    /// [`CsvError`] with the line, for missing columns, numbers that are missing or out of range, times that do not
    /// rise within a test, and a strain that does not rise.
    pub fn add(&mut self, path: &Path) -> Result<(), CsvError> {
        let table = Csv::open(path, &[])?;
        let column = |units: Units<'static>| units.iter().copied().find(|(name, _)| table.has(name));
        let columns = |units: [Units<'static>; 3]| -> Option<[(&'static str, f64); 3]> {
            let [a, b, c] = units.map(column);
            Some([a?, b?, c?])
        };
        match (columns([FREQUENCY, STORAGE, LOSS]), columns([STRESS, TIME, STRAIN])) {
            (Some(columns), None) => {
                for row in table.rows() {
                    let [frequency_rad_s, storage_kpa, loss_kpa] = positive(row, columns)?;
                    self.moduli.push(Modulus {
                        frequency_rad_s,
                        storage_kpa,
                        loss_kpa,
                    });
                }
                Ok(())
            }
            (None, Some(columns)) => self.add_creep(&table, columns),
            (columns, _) => Err(CsvError::Line {
                path: path.to_owned(),
                line: 1,
                found: match columns {
                    Some(_) => "the columns of both kinds of test".to_owned(),
                    None => "the columns of neither kind of test".to_owned(),
                },
                expected: EXPECTED.to_owned(),
            }),
        }
    }

    fn add_creep(&mut self, table: &Csv, columns: [(&'static str, f64); 3]) -> Result<(), CsvError> {
        let mut last_stress = f64::NAN;
        let mut last_time = 0.0;
        let [stress, time, _] = columns;
        let mut tests: Vec<(CreepTest, Row<'_>)> = Vec::new();
        for row in table.rows() {
            let stress_kpa = above(row, stress)?;
            let time_s = row.number(time.0)? * time.1;
            let begins = (stress_kpa - last_stress).abs() > SAME_STRESS * stress_kpa || last_stress.is_nan();
            if time_s < 0.0 || !begins && time_s <= last_time {
                let expected = "a time from 0 that rises from row to row while the stress stays the same; another specimen at the same \
                                stress has a file of its own";
                return Err(row.wrong(time.0, expected));
            }
            last_time = time_s;
            if begins {
                last_stress = stress_kpa;
                let rows = Vec::new();
                tests.push((CreepTest { stress_kpa, rows }, row));
            }
            // At the start of a test the strain is 0, or that of the machine.
            if time_s > 0.0
                && let Some((test, last_row)) = tests.last_mut()
            {
                test.rows.push([time_s, above(row, columns[2])?]);
                *last_row = row;
            }
        }
        for (test, last_row) in tests {
            let ends = test.rows.first().zip(test.rows.last());
            if ends.is_some_and(|(first_row, last_row)| test.rows.len() > 1 && last_row[1] <= first_row[1]) {
                return Err(last_row.wrong(columns[2].0, "a strain that rises from the start of a test to its end"));
            }
            self.creep.push(test);
        }
        Ok(())
    }
}

fn above(row: Row<'_>, (name, factor): (&'static str, f64)) -> Result<f64, CsvError> {
    let value = row.number(name)?;
    if value > 0.0 {
        Ok(value * factor)
    } else {
        Err(row.wrong(name, "a number above 0"))
    }
}

fn positive(row: Row<'_>, columns: [(&'static str, f64); 3]) -> Result<[f64; 3], CsvError> {
    let [a, b, c] = columns;
    Ok([above(row, a)?, above(row, b)?, above(row, c)?])
}
