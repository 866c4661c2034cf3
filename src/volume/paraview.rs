//! Colour maps as `ParaView` exports them: JSON with `RGBPoints` (value, red, green, blue, ...) and perhaps `Points`
//! (value, opacity, midpoint, sharpness, ...).
//!
//! The points are stretched over the transfer function's domain. Opacity is taken as per voxel of length; midpoint and
//! sharpness are not used. Colours are joined in RGB, whatever `ColorSpace` says.

use std::path::Path;

use serde_json::Value;

use super::Error;

/// Points in data values; opacity may be missing.
pub struct Map {
    /// Colours.
    pub colour: Vec<(f64, [f64; 3])>,
    /// Opacities.
    pub opacity: Vec<(f64, [f64; 1])>,
}

/// Reads the first colour map of a file.
///
/// # Errors
/// [`Error::Io`] and [`Error::File`].
pub fn read(path: &Path, domain: (f64, f64)) -> Result<Map, Error> {
    let text = crate::read::text(path, "read the colour map")?;
    parse(&text, domain).map_err(|why| Error::File { path: path.into(), why })
}

fn parse(text: &str, (low, high): (f64, f64)) -> Result<Map, String> {
    let json: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let map = json.get(0).unwrap_or(&json);
    let colours = numbers(map.get("RGBPoints")).ok_or("there is no list RGBPoints of numbers")?;
    let opacities = numbers(map.get("Points")).unwrap_or_default();
    let ends = |first: Option<f64>, last: Option<f64>| (first.unwrap_or(0.0), last.unwrap_or(1.0));
    let of = |list: &[f64]| ends(list.first().copied(), list.len().checked_sub(4).map(|at| list[at]));
    let stretch = |at: f64, (first, last): (f64, f64)| {
        let share = if last > first { (at - first) / (last - first) } else { 0.0 };
        low + share * (high - low)
    };
    let span = of(&colours);
    Ok(Map {
        colour: colours.chunks_exact(4).map(|p| (stretch(p[0], span), [p[1], p[2], p[3]])).collect(),
        opacity: opacities.chunks_exact(4).map(|p| (stretch(p[0], of(&opacities)), [p[1]])).collect(),
    })
}

fn numbers(value: Option<&Value>) -> Option<Vec<f64>> {
    let list: Option<Vec<f64>> = value?.as_array()?.iter().map(Value::as_f64).collect();
    list.filter(|list| list.len() >= 4 && list.len() % 4 == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_stretched_over_the_domain() {
        let text = r#"[{"ColorSpace": "Diverging", "Name": "x", "Points": [0, 0.1, 0.5, 0, 1, 0.9, 0.5, 0],
            "RGBPoints": [10, 0.1, 0.2, 0.3, 15, 0.4, 0.5, 0.6, 20, 1, 1, 1]}]"#;
        let map = parse(text, (100.0, 300.0)).unwrap();
        assert_eq!(map.colour, [(100.0, [0.1, 0.2, 0.3]), (200.0, [0.4, 0.5, 0.6]), (300.0, [1.0; 3])]);
        assert_eq!(map.opacity, [(100.0, [0.1]), (300.0, [0.9])]);
        for bad in ["", "[]", "{}", r#"{"RGBPoints": [1, 2]}"#, r#"{"RGBPoints": "x"}"#] {
            assert!(parse(bad, (0.0, 1.0)).is_err(), "{bad}");
        }
    }
}
