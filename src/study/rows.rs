//! The results of a study: a row a cell, as a journal that is continued, as CSV and as JSON.

use serde::{Deserialize, Serialize};

use crate::report::csv_line;

/// What was found for one cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What tells the cell from others; equal keys mean equal results.
    pub key: String,
    /// The frame's name.
    pub frame: String,
    /// What kind of picture it is.
    pub class: String,
    /// The pattern's name.
    pub pattern: String,
    /// Measured pixels over all pixels, as asked for.
    pub density: f64,
    /// Missing pixels over all pixels, as they came.
    pub missing: f64,
    /// Which pattern.
    pub seed: u64,
    /// The filter as the study's file has it.
    pub filter: String,
    /// Everything that it was set to.
    pub settings: String,
    /// Mean squared error of the colours; of a sequence the geometric mean over its frames, so that its PSNR is the mean of theirs, those that
    /// are equal left out.
    pub mse: Option<f64>,
    /// The same over the missing pixels.
    pub mse_missing: Option<f64>,
    /// How many frames are equal to their references.
    #[serde(default)]
    pub equal: usize,
    /// Mean structural similarity.
    pub ssim: Option<f64>,
    /// Mean distance in CIELUV.
    pub cieluv: Option<f64>,
    /// Root mean square change of the error from frame to frame, where pixels are missing in either; of sequences.
    #[serde(default)]
    pub flicker: Option<f64>,
    /// Processor seconds of planning and solving, on one thread; of a sequence, those of a frame.
    pub seconds: f64,
    /// The same by the clock on the wall.
    pub wall_seconds: f64,
    /// Iterations, 0 for direct methods.
    pub iterations: usize,
    /// How the solver ended.
    pub stop: Option<String>,
    /// Why there is no result.
    pub error: Option<String>,
}

impl Row {
    /// PSNR in dB, peak 1; infinite for equal images.
    pub fn psnr(&self) -> Option<f64> {
        self.mse.map(psnr)
    }
}

fn psnr(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// The row as a line of the journal.
pub fn journal(row: &Row) -> String {
    serde_json::to_string(row).map_or_else(|_| String::new(), |line| line + "\n")
}

/// The rows of a journal; lines that are damaged (the last one of a run that was killed) are passed over, and rows of cells
/// that failed, so that they are tried again.
pub fn read_journal(bytes: &[u8]) -> Vec<Row> {
    let rows = bytes.split(|&byte| byte == b'\n').filter_map(|line| serde_json::from_slice::<Row>(line).ok());
    rows.filter(|row| row.error.is_none()).collect()
}

/// All rows as CSV (RFC 4180), a head line first.
pub fn csv(rows: &[Row]) -> String {
    let head = "frame,class,pattern,density,missing,seed,filter,settings,psnr_db,psnr_missing_db,equal,ssim,cieluv,flicker,seconds,\
                wall_seconds,iterations,stop,error\n";
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let line = |row: &Row| {
        let cells = [
            row.frame.clone(),
            row.class.clone(),
            row.pattern.clone(),
            row.density.to_string(),
            if row.error.is_some() { String::new() } else { row.missing.to_string() },
            row.seed.to_string(),
            row.filter.clone(),
            row.settings.clone(),
            number(row.psnr()),
            number(row.mse_missing.map(psnr)),
            if row.error.is_some() { String::new() } else { row.equal.to_string() },
            number(row.ssim),
            number(row.cieluv),
            number(row.flicker),
            row.seconds.to_string(),
            row.wall_seconds.to_string(),
            row.iterations.to_string(),
            row.stop.clone().unwrap_or_default(),
            row.error.clone().unwrap_or_default(),
        ];
        csv_line(cells.into_iter())
    };
    rows.iter().map(line).fold(head.to_owned(), |text, line| text + &line)
}

/// All rows as JSON, with PSNR beside the errors, over the whole image and the missing pixels (the text `inf` for equal ones, null without a result).
pub fn json(title: &str, rows: &[Row]) -> Result<String, String> {
    let mut list = Vec::new();
    for row in rows {
        let mut value = serde_json::to_value(row).map_err(|error| error.to_string())?;
        if let Some(object) = value.as_object_mut() {
            for name in ["missing", "equal"].into_iter().filter(|_| row.error.is_some()) {
                object.insert(name.into(), serde_json::Value::Null);
            }
            for (name, mse) in [("psnr", row.mse), ("psnr_missing", row.mse_missing)] {
                let shown = mse.map(psnr).map_or(serde_json::Value::Null, |psnr| {
                    if psnr.is_finite() { serde_json::json!(psnr) } else { psnr.to_string().into() }
                });
                object.insert(name.into(), shown);
            }
        }
        list.push(value);
    }
    let all = serde_json::json!({ "lacuna": env!("CARGO_PKG_VERSION"), "title": title, "rows": list });
    serde_json::to_string_pretty(&all).map(|text| text + "\n").map_err(|error| error.to_string())
}
