//! Self-contained HTML report of a run.

use super::film::Film;
use crate::scenario::summary::Summary;
use crate::study::page::{Cell, Page, escape};
use crate::study::plot::{Plot, PlotError};

/// Maximum number of rows of a table.
const ROWS: usize = 200;

pub(super) fn page(
    title: &str,
    summary: &Summary,
    film: &Film,
    plots: &[Plot],
    others: &[&str],
) -> Result<String, PlotError> {
    let mut page = Page::new(title);
    for warning in &summary.warnings {
        page.paragraph("warning", warning);
    }
    table(&mut page, "", &["", ""], figures(summary));
    frames(&mut page, film);
    for plot in plots {
        let untitled = Plot {
            title: String::new(),
            ..plot.clone()
        };
        page.wide_figure(&untitled.svg()?, &plot.title);
    }
    targets(&mut page, summary);
    seeds(&mut page, summary);
    changes(&mut page, summary);
    events(&mut page, summary);
    let links = others
        .iter()
        .map(|name| format!("<a href=\"{0}\">{0}</a>", escape(name)));
    let links = links.collect::<Vec<_>>().join(", ");
    page.put(format_args!("<h2>Files</h2><p>{links}</p>"));
    Ok(page.finish())
}

/// Adds the most informative frames, and the others behind a slider.
fn frames(page: &mut Page, film: &Film) {
    let chosen = film.chosen();
    if chosen.is_empty() {
        return;
    }
    page.put("<h2>Frames</h2><div class=\"figures\">");
    for (what, shot) in chosen {
        if let Ok(address) = shot.address() {
            page.picture(&address, &format!("{what}: {}", shot.caption()));
        }
    }
    page.put("</div>");
    let shots = film.shots().iter();
    let shots: Vec<_> = shots
        .filter_map(|shot| Some((shot.address().ok()?, shot.caption())))
        .collect();
    page.slider(&shots);
}

fn figures(summary: &Summary) -> Vec<Vec<String>> {
    let ms = &summary.step_ms;
    let remesh = ms
        .remesh_max
        .map_or("no step remeshed".to_owned(), |most| format!("{most:.3} ms"));
    let mut rows = vec![
        (
            "Simulated".to_owned(),
            format!("{:.3} s in {} steps", summary.simulated_s, summary.steps),
        ),
        (
            "Mesh".to_owned(),
            format!("{} nodes, {} tetrahedra", summary.nodes, summary.elements),
        ),
        (
            "Largest force on the hand".to_owned(),
            format!("{:.3} N", summary.max_base_force_n),
        ),
        (
            "Largest tip deflection".to_owned(),
            format!("{:.3} mm", summary.tip_deflection_mm),
        ),
        ("Largest depth".to_owned(), format!("{:.2} mm", summary.max_inserted_mm)),
        ("Remeshes".to_owned(), summary.remeshes.to_string()),
        (
            "Time of a step".to_owned(),
            format!(
                "median {:.3} ms, 95 % {:.3}, 99 % {:.3}, longest {:.3}",
                ms.median, ms.p95, ms.p99, ms.max
            ),
        ),
        ("Longest step that remeshes".to_owned(), remesh),
    ];
    if let Some(force) = summary.max_probe_force_n {
        rows.push(("Largest force on the probe".to_owned(), format!("{force:.3} N")));
    }
    let nearest = summary.targets.iter().map(|target| {
        let what = format!("Least distance of the tip from the target ({})", target.name);
        (what, format!("{:.2} mm", target.nearest_tip_mm))
    });
    rows.extend(nearest);
    rows.into_iter().map(|(what, figure)| vec![what, figure]).collect()
}

fn targets(page: &mut Page, summary: &Summary) {
    let rows = summary.targets.iter().map(|target| {
        let seed = target
            .nearest_seed_mm
            .map_or("none".to_owned(), |distance| format!("{distance:.2}"));
        vec![
            target.name.clone(),
            place(target.at_mm),
            format!("{:.2}", target.nearest_tip_mm),
            seed,
        ]
    });
    let heads = ["target", "at, mm", "least distance of the tip, mm", "nearest seed, mm"];
    table(page, "Targets", &heads, rows.collect());
}

fn seeds(page: &mut Page, summary: &Summary) {
    let rows = summary.seeds.iter().map(|seed| {
        vec![
            format!("{:.2}", seed.time_s),
            seed.planned_mm.map_or_else(String::new, place),
            seed.deposited_mm.map_or("outside the tissue".to_owned(), place),
            seed.distance_mm
                .map_or_else(String::new, |distance| format!("{distance:.2}")),
        ]
    });
    let heads = ["left at, s", "planned, mm", "deposited, mm", "distance, mm"];
    table(page, "Seeds", &heads, rows.collect());
}

fn changes(page: &mut Page, summary: &Summary) {
    let rows = summary.level_changes.iter().map(|change| {
        vec![
            format!("{:.3}", change.time_s),
            format!("{} to {}", change.from, change.to),
            format!("{:.3e}", change.force_jump_n),
            format!("{:.3}", change.seconds),
        ]
    });
    let heads = [
        "at, s",
        "level of remeshing",
        "jump of the force on the hand, N",
        "took, s",
    ];
    table(page, "Changes of level", &heads, rows.collect());
}

fn events(page: &mut Page, summary: &Summary) {
    let rows = summary
        .events
        .iter()
        .map(|event| vec![format!("{:.3}", event.time_s), event.text.clone(), place(event.at_mm)]);
    table(page, "Events", &["at, s", "what", "where, mm"], rows.collect());
}

fn table(page: &mut Page, title: &str, heads: &[&str], rows: Vec<Vec<String>>) {
    if rows.is_empty() {
        return;
    }
    if !title.is_empty() {
        page.put(format_args!("<h2>{title}</h2>"));
    }
    let more = rows.len().saturating_sub(ROWS);
    let heads: Vec<_> = heads.iter().map(|head| Cell::Text((*head).to_owned())).collect();
    let rows = rows.into_iter().take(ROWS);
    let rows: Vec<_> = rows
        .map(|row| ("", row.into_iter().map(Cell::Text).collect()))
        .collect();
    page.table(&heads, &rows);
    if more > 0 {
        page.paragraph("soft", &format!("{more} more are in summary.json."));
    }
}

fn place(at_mm: [f64; 3]) -> String {
    at_mm.map(|x| format!("{x:.1}")).join(", ")
}
