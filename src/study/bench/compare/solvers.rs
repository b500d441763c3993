//! Remeshing levels on CPU and GPU, by mesh size.

use std::time::Duration;

use super::{CPU_MS, CompareError, CompareOptions, GPU_MS, RATIO, factor, ratio};
use crate::study::tradeoff::remesh::subject::generated;
use crate::study::tradeoff::remesh::{RemeshOptions, study};
use crate::study::tradeoff::{Axis, Row, Table};

/// Number of moves per insertion.
const MOVES: usize = 6;

/// Measures the levels available on both, in single precision; the remeshing study covers errors and the other levels.
pub fn solvers(options: &CompareOptions) -> Result<Table, CompareError> {
    let factors = [factor("gpu", "GPU"), factor("what", "what"), factor("nodes", "nodes")];
    let axes = [
        Axis::log("dofs", "dofs", "free degrees of freedom"),
        CPU_MS,
        GPU_MS,
        Axis::log(
            "device_ms",
            "of it computing",
            "time of the update on the device (median), ms",
        ),
        RATIO,
    ];
    let title = "Remeshing, single precision: one move with its K^c, transfers included";
    let mut table = Table::new("compare_solvers", title, &factors, &axes);
    let meshes = options.nodes.iter().map(|&nodes| generated(nodes));
    let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
    let remeshing = RemeshOptions {
        moves: MOVES,
        updates: options.updates,
        patience: 4 * options.patience + Duration::from_millis(200),
        ..RemeshOptions::default()
    };
    let found = study(&meshes, &options.gpus, &remeshing, &mut |_, _| {})?;
    let Some(remesh) = found.tables.iter().find(|table| table.key == "remesh") else {
        return Ok(table);
    };
    let choice = |row: &Row, key: &str| {
        let at = remesh.factors.iter().position(|factor| factor.key == key)?;
        Some(row.choices[at].clone())
    };
    let value = |row: &Row, key: &str| row.values[remesh.axes.iter().position(|axis| axis.key == key)?];
    let single: Vec<&Row> = remesh
        .rows
        .iter()
        .filter(|row| choice(row, "precision").is_some_and(|precision| precision.contains("32")))
        .collect();
    for row in single
        .iter()
        .filter(|row| choice(row, "backend").as_deref() == Some("CPU"))
    {
        let alike = |other: &&&Row| {
            ["nodes", "level"]
                .iter()
                .all(|key| choice(other, key) == choice(row, key))
        };
        let on_gpus: Vec<&&Row> = single
            .iter()
            .filter(alike)
            .filter(|other| choice(other, "backend").as_deref() != Some("CPU"))
            .collect();
        let names = |gpu: String| {
            let level = choice(row, "level").unwrap_or_default();
            vec![
                gpu,
                format!("remeshing, level {level}"),
                choice(row, "nodes").unwrap_or_default(),
            ]
        };
        let (dofs, cpu) = (value(row, "dofs"), value(row, "median_ms"));
        for other in &on_gpus {
            let gpu = value(other, "median_ms");
            let values = vec![dofs, cpu, gpu, value(other, "device_ms"), ratio(cpu, gpu)];
            table.push(names(choice(other, "backend").unwrap_or_default()), values, None);
        }
        if on_gpus.is_empty() {
            table.push(names("none".to_owned()), vec![dofs, cpu, None, None, None], None);
        }
    }
    Ok(table)
}
