//! Colour maps as `ParaView` exports them: JSON with `RGBPoints` (value, red, green, blue, ...) and perhaps `Points`
//! (value, opacity, midpoint, sharpness, ...).
//!
//! The points are stretched over the transfer function's domain. Opacity is taken as per voxel of length. The midpoint and the
//! sharpness of a point shape the opacity up to the next one: a sharpness of 0 makes two lines that meet at the midpoint, 1 a step
//! there; what lies between is joined by lines too. Colours are joined in RGB. What else a file asks for is told.

use std::path::Path;

use serde_json::Value;

use super::Error;
use super::transfer::Joining;

/// Sharpness beyond these is 0 and 1, as VTK's `vtkPiecewiseFunction` has it.
const SHARPNESS: [f64; 2] = [0.01, 0.99];
/// Midpoints keep so far from the ends, as there.
const MIDPOINT: f64 = 1e-5;

/// Points in data values; opacity may be missing.
#[derive(Debug)]
pub struct Map {
    /// Colours.
    pub colour: Vec<(f64, [f64; 3])>,
    /// Opacities.
    pub opacity: Vec<(f64, [f64; 1])>,
    /// What the file asks for that is not followed, on one line.
    pub note: Option<String>,
}

/// Reads the first colour map of a file.
///
/// # Errors
/// [`Error::Io`] and [`Error::File`].
pub fn read(path: &Path, domain: (f64, f64), joining: Joining) -> Result<Map, Error> {
    let text = crate::read::text(path, "read the colour map")?;
    let mut map = parse(&text, domain, joining).map_err(|why| Error::File { path: path.into(), why })?;
    map.note = map.note.map(|note| format!("{}: {note}", path.display()));
    Ok(map)
}

fn parse(text: &str, (low, high): (f64, f64), joining: Joining) -> Result<Map, String> {
    let json: Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let map = json.get(0).unwrap_or(&json);
    let colours = numbers(map.get("RGBPoints")).ok_or("there is no list RGBPoints of numbers")?;
    let opacities = numbers(map.get("Points")).unwrap_or_default();
    if let Some([_, opacity, ..]) = opacities.iter().find(|p| !(0.0..=1.0).contains(&p[1])) {
        return Err(format!("Points: the opacity {opacity} is not within 0 and 1"));
    }
    let stretched = |points: &[[f64; 4]]| {
        let (first, last) = (points.first().map_or(0.0, |p| p[0]), points.last().map_or(1.0, |p| p[0]));
        move |at: f64| low + if last > first { (at - first) / (last - first) } else { 0.0 } * (high - low)
    };
    let (place, span) = (stretched(&colours), stretched(&opacities));
    let opacity = if joining == Joining::Linear { shaped(&opacities) } else { plain(&opacities) };
    let others = json.as_array().map_or(0, |maps| maps.len().saturating_sub(1));
    Ok(Map {
        colour: colours.iter().map(|p| (place(p[0]), [p[1], p[2], p[3]])).collect(),
        opacity: opacity.into_iter().map(|(at, value)| (span(at), value)).collect(),
        note: note(map, &opacities, others),
    })
}

type Opacities = Vec<(f64, [f64; 1])>;

fn plain(points: &[[f64; 4]]) -> Opacities {
    points.iter().map(|p| (p[0], [p[1]])).collect()
}

/// Opacities with what midpoints and sharpness put between them.
fn shaped(points: &[[f64; 4]]) -> Opacities {
    let mut found = Vec::new();
    for (k, &[at, from, midpoint, sharpness]) in points.iter().enumerate() {
        found.push((at, [from]));
        let Some(&[end, to, ..]) = points.get(k + 1) else { break };
        let middle = at + midpoint.clamp(MIDPOINT, 1.0 - MIDPOINT) * (end - at);
        if sharpness > SHARPNESS[1] {
            found.extend([(middle, [from]), (middle, [to])]);
        } else if midpoint != 0.5 {
            found.push((middle, [0.5 * (from + to)]));
        }
    }
    found
}

/// What a map, and a file with others beside it, asks for that is not followed.
fn note(map: &Value, opacities: &[[f64; 4]], others: usize) -> Option<String> {
    let space = map.get("ColorSpace").and_then(Value::as_str).filter(|space| *space != "RGB");
    let set = |value: &Value| value.as_bool().unwrap_or_else(|| value.as_f64().is_some_and(|n| n != 0.0));
    let log = map.get("UseLogScale").is_some_and(set);
    let joined = opacities.split_last().map_or(&[][..], |(_, joined)| joined);
    let bent = joined.iter().any(|p| (SHARPNESS[0]..=SHARPNESS[1]).contains(&p[3]));
    let name = map.get("Name").and_then(Value::as_str).unwrap_or_default();
    let notes = [
        space.map(|space| format!("ColorSpace {space} (colours are joined in RGB)")),
        log.then(|| "UseLogScale (values are spread evenly)".into()),
        bent.then(|| "sharpness between 0 and 1 (opacities are joined by lines)".into()),
        (others > 0).then(|| format!("{others} further maps (the first is taken: {name})")),
    ];
    let notes: Vec<String> = notes.into_iter().flatten().collect();
    (!notes.is_empty()).then(|| format!("not followed: {}", notes.join(", ")))
}

/// Points of four numbers each.
fn numbers(value: Option<&Value>) -> Option<Vec<[f64; 4]>> {
    let list: Option<Vec<f64>> = value?.as_array()?.iter().map(Value::as_f64).collect();
    let list = list?;
    let (points, rest) = list.as_chunks::<4>();
    (!points.is_empty() && rest.is_empty()).then(|| points.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_stretched_over_the_domain() {
        let text = r#"[{"ColorSpace": "RGB", "Name": "x", "Points": [0, 0.1, 0.5, 0, 1, 0.9, 0.5, 0],
            "RGBPoints": [10, 0.1, 0.2, 0.3, 15, 0.4, 0.5, 0.6, 20, 1, 1, 1]}]"#;
        let map = parse(text, (100.0, 300.0), Joining::Linear).unwrap();
        assert_eq!(map.colour, [(100.0, [0.1, 0.2, 0.3]), (200.0, [0.4, 0.5, 0.6]), (300.0, [1.0; 3])]);
        assert_eq!((map.opacity, map.note), (vec![(100.0, [0.1]), (300.0, [0.9])], None));
        for bad in ["", "[]", "{}", r#"{"RGBPoints": [1, 2]}"#, r#"{"RGBPoints": "x"}"#] {
            assert!(parse(bad, (0.0, 1.0), Joining::Linear).is_err(), "{bad}");
        }
        let bad = parse(&text.replace("0.9", "1.9"), (0.0, 1.0), Joining::Linear).unwrap_err();
        assert!(bad.contains("the opacity 1.9"), "{bad}");
    }

    #[test]
    fn midpoints_and_steps_are_those_of_vtk() {
        let text =
            r#"{"RGBPoints": [0, 1, 1, 1], "Points": [0, 0.2, 0.25, 0, 4, 0.6, 0.75, 1, 8, 1, 0.1, 0.5]}"#;
        let map = parse(text, (0.0, 8.0), Joining::Linear).unwrap();
        let expected = [(0.0, [0.2]), (1.0, [0.4]), (4.0, [0.6]), (7.0, [0.6]), (7.0, [1.0]), (8.0, [1.0])];
        assert_eq!((map.opacity.as_slice(), map.note), (&expected[..], None));
        let map = parse(text, (0.0, 8.0), Joining::Constant).unwrap();
        assert_eq!(map.opacity, [(0.0, [0.2]), (4.0, [0.6]), (8.0, [1.0])]);
    }

    #[test]
    fn what_is_not_followed_is_told() {
        let text = r#"[{"ColorSpace": "Diverging", "Name": "warm", "UseLogScale": 1, "RGBPoints": [0, 1, 1, 1],
            "Points": [0, 0.2, 0.5, 0.5, 4, 0.6, 0.5, 0]}, {}, {}]"#;
        let note = parse(text, (0.0, 8.0), Joining::Linear).unwrap().note.unwrap();
        for part in ["ColorSpace Diverging", "UseLogScale", "sharpness", "2 further maps", "warm"] {
            assert!(note.contains(part), "{part}: {note}");
        }
        let plain = text
            .replace("Diverging", "RGB")
            .replace("Scale\": 1", "Scale\": 0")
            .replace("0.5, 0.5", "0.5, 0");
        let note = parse(&plain.replace(", {}, {}", ""), (0.0, 8.0), Joining::Linear).unwrap().note;
        assert_eq!(note, None);
    }
}
