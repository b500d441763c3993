//! Scenario files rewritten with another motion of the needle.

/// Table of a scenario, taken out of it; empty if the scenario has none.
pub(super) fn part(table: &mut toml::Table, key: &str) -> Result<toml::Table, String> {
    match table.remove(key) {
        None => Ok(toml::Table::new()),
        Some(toml::Value::Table(part)) => Ok(part),
        Some(_) => Err(format!(
            "`{key}` names a file; expected a table, in which the task places probe and needle"
        )),
    }
}

/// List of three numbers.
pub(super) fn list(values: [f64; 3]) -> toml::Value {
    toml::Value::Array(values.map(toml::Value::Float).to_vec())
}

/// Replaces the motion of the needle (time, s; tip, mm; direction), and all targets by one.
pub(super) fn motion(
    table: &mut toml::Table,
    keys: impl IntoIterator<Item = (f64, [f64; 3], [f64; 3])>,
    target: toml::Table,
) -> Result<(), String> {
    let mut needle = part(table, "needle")?;
    for key in ["target", "entry", "deposit_s"] {
        needle.remove(key);
    }
    let keyframes = keys.into_iter().map(|(time_s, tip, direction)| {
        let mut key = toml::Table::new();
        key.insert("time_s".to_owned(), time_s.into());
        key.insert("tip_mm".to_owned(), list(tip));
        key.insert("direction".to_owned(), list(direction));
        toml::Value::Table(key)
    });
    let mut motion = toml::Table::new();
    motion.insert("keyframes".to_owned(), toml::Value::Array(keyframes.collect()));
    needle.insert("motion".to_owned(), motion.into());
    // Each motion has its own length.
    let mut run = part(table, "run")?;
    run.remove("duration_s");
    let mut plan = part(table, "plan")?;
    plan.remove("needle");
    plan.remove("template");
    plan.insert("target".to_owned(), toml::Value::Array(vec![target.into()]));
    for (key, part) in [("needle", needle), ("run", run), ("plan", plan)] {
        table.insert(key.to_owned(), part.into());
    }
    Ok(())
}
