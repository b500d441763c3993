//! A page that shows a run: one file, without anything from elsewhere.

use std::fmt::Write;

use crate::scenario::summary::Summary;
use crate::study::plot::{Plot, PlotError};

/// Most rows of a table.
const ROWS: usize = 200;

/// Plots keep their lettering readable on a narrow screen: they scroll there rather than shrink.
const STYLE: &str = "\
:root{color-scheme:light dark}\
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;padding:1rem;max-width:66rem}\
h1{font-size:1.4rem}h2{font-size:1.1rem;margin-top:2rem}\
.wide{overflow-x:auto}\
svg{display:block;width:100%;min-width:44rem;height:auto;background:#fff}\
table{border-collapse:collapse}th,td{padding:.2rem .8rem .2rem 0;text-align:left;vertical-align:top}\
td{font-variant-numeric:tabular-nums}\
.warning{border-left:.3rem solid #d55e00;padding-left:.6rem}";

pub(super) fn page(title: &str, summary: &Summary, plots: &[Plot]) -> Result<String, PlotError> {
    let title = escape(title);
    let mut text = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>{title}</title><style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n"
    );
    for warning in &summary.warnings {
        put(
            &mut text,
            format_args!("<p class=\"warning\">{}</p>\n", escape(warning)),
        );
    }
    figures(&mut text, summary);
    for plot in plots {
        let heading = escape(&plot.title);
        put(
            &mut text,
            format_args!("<h2>{heading}</h2>\n<div class=\"wide\">{}</div>\n", plot.svg()?),
        );
    }
    targets(&mut text, summary);
    seeds(&mut text, summary);
    events(&mut text, summary);
    text.push_str("</body></html>\n");
    Ok(text)
}

/// Writing to a string does not fail.
fn put(text: &mut String, what: std::fmt::Arguments<'_>) {
    let _ = text.write_fmt(what);
}

fn figures(text: &mut String, summary: &Summary) {
    let ms = &summary.step_ms;
    let remesh = ms
        .remesh_max
        .map_or("no step remeshed".to_owned(), |most| format!("{most:.3} ms"));
    let mut rows = vec![
        (
            "Simulated",
            format!("{:.3} s in {} steps", summary.simulated_s, summary.steps),
        ),
        (
            "Mesh",
            format!("{} nodes, {} tetrahedra", summary.nodes, summary.elements),
        ),
        (
            "Largest force on the hand",
            format!("{:.3} N", summary.max_base_force_n),
        ),
        ("Largest tip deflection", format!("{:.3} mm", summary.tip_deflection_mm)),
        ("Largest depth", format!("{:.2} mm", summary.max_inserted_mm)),
        ("Remeshes", summary.remeshes.to_string()),
        (
            "Time of a step",
            format!(
                "median {:.3} ms, 95 % {:.3}, 99 % {:.3}, longest {:.3}",
                ms.median, ms.p95, ms.p99, ms.max
            ),
        ),
        ("Longest step that remeshes", remesh),
    ];
    if let Some(force) = summary.max_probe_force_n {
        rows.push(("Largest force on the probe", format!("{force:.3} N")));
    }
    text.push_str("<table>\n");
    for (what, figure) in rows {
        put(
            text,
            format_args!("<tr><th>{what}</th><td>{}</td></tr>\n", escape(&figure)),
        );
    }
    text.push_str("</table>\n");
}

fn targets(text: &mut String, summary: &Summary) {
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
    table(
        text,
        "Targets",
        &["target", "at, mm", "tip came within, mm", "nearest seed, mm"],
        rows.collect(),
    );
}

fn seeds(text: &mut String, summary: &Summary) {
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
    table(text, "Seeds", &heads, rows.collect());
}

fn events(text: &mut String, summary: &Summary) {
    let rows = summary.events.iter().map(|event| {
        vec![
            format!("{:.3}", event.time_s),
            event.kind.to_owned(),
            event.region.clone().unwrap_or_default(),
            place(event.at_mm),
        ]
    });
    table(
        text,
        "Events",
        &["at, s", "what", "region", "where, mm"],
        rows.collect(),
    );
}

fn table(text: &mut String, title: &str, heads: &[&str], rows: Vec<Vec<String>>) {
    if rows.is_empty() {
        return;
    }
    put(
        text,
        format_args!("<h2>{title}</h2>\n<div class=\"wide\"><table>\n<tr>"),
    );
    heads.iter().for_each(|head| put(text, format_args!("<th>{head}</th>")));
    text.push_str("</tr>\n");
    for row in rows.iter().take(ROWS) {
        text.push_str("<tr>");
        row.iter()
            .for_each(|cell| put(text, format_args!("<td>{}</td>", escape(cell))));
        text.push_str("</tr>\n");
    }
    text.push_str("</table></div>\n");
    if rows.len() > ROWS {
        put(
            text,
            format_args!("<p>{} more are in summary.json.</p>\n", rows.len() - ROWS),
        );
    }
}

fn place(at_mm: [f64; 3]) -> String {
    at_mm.map(|x| format!("{x:.1}")).join(", ")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
