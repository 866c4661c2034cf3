//! The study as one HTML page: verdicts, figures, sheets and every row.

use std::fmt::Write;

use super::definition::Definition;
use super::figures::Figure;
use super::rows::Row;
use super::verdict::{percents, verdicts};
use crate::report::{base64, escape, shell};

/// The page; `sheets` are names and pictures.
pub fn page(
    definition: &Definition,
    rows: &[Row],
    figures: &[Figure],
    sheets: &[(String, String)],
) -> String {
    let mut body = format!(
        "<header><h1>{}</h1>{}</header>\n<main>\n",
        escape(&definition.title),
        summary(definition, rows)
    );
    judged(definition, rows, &mut body);
    body.push_str("<section><h2>Figures</h2>\n<div class=\"plots wide\">\n");
    for figure in figures {
        let _ = writeln!(
            body,
            "<figure class=\"plot\" aria-label=\"{}\">{}</figure>",
            escape(&figure.title),
            figure.svg
        );
    }
    body.push_str("</div></section>\n");
    if !sheets.is_empty() {
        body.push_str(
            "<section><h2>Results and errors side by side</h2>\n<p>Top to bottom: result, distance in CIELUV (0 black, 20 \
             white), SSIM squared (0 black, 1 white).</p>\n",
        );
        for (name, svg) in sheets {
            // A picture in a file that was there runs no script and draws nothing outside itself.
            let picture = base64(svg.as_bytes());
            let _ = writeln!(
                body,
                "<h3>{0}</h3><div class=\"scroll sheet\"><img alt=\"{0}\" src=\"data:image/svg+xml;base64,{picture}\"></div>",
                escape(name)
            );
        }
        body.push_str("</section>\n");
    }
    all(rows, &mut body);
    body.push_str("</main>\n");
    shell(&escape(&definition.title), &body, "", true)
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn summary(definition: &Definition, rows: &[Row]) -> String {
    let failed = rows.iter().filter(|row| row.error.is_some()).count();
    let bad = if failed > 0 {
        format!("<p class=\"verdict bad\">{} failed; the table says why</p>", counted(failed, "cell"))
    } else {
        String::new()
    };
    format!(
        "{bad}<p>{}: {}, patterns {}, densities {}, {}, filters {}. {}. lacuna {}.</p>",
        counted(rows.len(), "cell"),
        counted(definition.frames.len(), "frame"),
        escape(&definition.patterns.join(", ")),
        percents(&definition.densities).join(", "),
        counted(definition.seeds.len(), "seed"),
        escape(&definition.filters.join(", ")),
        if definition.display {
            "Compared after the sRGB curve"
        } else {
            "Compared as linear values, clipped to 0 to 1"
        },
        env!("CARGO_PKG_VERSION"),
    )
}

fn judged(definition: &Definition, rows: &[Row], body: &mut String) {
    let _ = write!(
        body,
        "<section><h2>Verdict</h2>\n<p>By the worst frame of each class: good from {} dB on, acceptable from {} dB on.</p>\n\
         <div class=\"scroll\"><table class=\"words\"><thead><tr><th scope=\"col\">class</th><th scope=\"col\">filter</th><th scope=\"col\">verdict</th>\
         <th scope=\"col\">frames</th></tr></thead><tbody>",
        definition.verdict.good, definition.verdict.acceptable
    );
    for verdict in verdicts(rows, definition.verdict) {
        let filter = verdict.filter.as_deref().map_or_else(|| "<b>best each time</b>".into(), escape);
        let _ = write!(
            body,
            "<tr><th scope=\"row\">{}</th><td>{filter}</td><td>{}</td><td>{}</td></tr>",
            escape(&verdict.class),
            escape(&verdict.text),
            escape(&verdict.frames.join(", "))
        );
    }
    body.push_str("</tbody></table></div></section>\n");
}

/// Every row, in a table that sorts.
fn all(rows: &[Row], body: &mut String) {
    body.push_str("<section><h2>Every cell</h2>\n<details><summary>Table</summary><div class=\"scroll\"><table id=\"frames\"><thead><tr>");
    body.push_str("<th scope=\"col\">frame</th><th scope=\"col\">filter</th><th scope=\"col\">pattern</th>");
    for head in [
        "density (%)",
        "missing (%)",
        "seed",
        "PSNR (dB)",
        "SSIM",
        "CIELUV",
        "flicker",
        "seconds",
        "iterations",
    ] {
        let _ = write!(body, "<th scope=\"col\" data-sort=\"number\">{head}</th>");
    }
    body.push_str("</tr></thead><tbody>\n");
    for row in rows {
        let class = if row.error.is_some() { " class=\"bad\"" } else { "" };
        let _ = write!(
            body,
            "<tr{class}><th scope=\"row\">{}</th><td title=\"{}\">{}</td><td>{}</td>",
            escape(&row.frame),
            escape(&row.settings),
            escape(&row.filter),
            escape(&row.pattern)
        );
        if let Some(error) = &row.error {
            let _ = writeln!(body, "<td class=\"notes\" colspan=\"9\">{}</td></tr>", escape(error));
            continue;
        }
        let mut cell = |value: Option<f64>, digits: usize| {
            let _ = match value {
                Some(value) => write!(body, "<td data-value=\"{value}\">{value:.digits$}</td>"),
                None => write!(body, "<td>–</td>"),
            };
        };
        cell(Some(100.0 * row.density), 1);
        cell(Some(100.0 * row.missing), 1);
        cell(Some(row.seed as f64), 0);
        cell(row.psnr(), 2);
        cell(row.ssim, 5);
        cell(row.cieluv, 4);
        cell(row.flicker, 5);
        cell(Some(row.seconds), 3);
        cell(Some(row.iterations as f64), 0);
        body.push_str("</tr>\n");
    }
    body.push_str("</tbody></table></div></details></section>\n");
}
