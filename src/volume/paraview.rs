//! Colour maps as `ParaView` exports them: JSON with `RGBPoints` (value, red, green, blue, ...) and perhaps `Points`
//! (value, opacity, midpoint, sharpness, ...).
//!
//! The points are stretched over the transfer function's domain. Opacity is taken as per voxel of length. The midpoint and the
//! sharpness of a point shape the opacity up to the next one: a sharpness of 0 makes two lines that meet at the midpoint, 1 a step
//! there; what lies between is joined by lines too. Colours are joined in the file's `ColorSpace`, over logarithms of the values with
//! `UseLogScale`, by [`STEPS`] lines from one point to the next. What else a file asks for is told.

use std::path::Path;

use serde_json::Value;

use super::Error;
use super::colour_space::{Rgb, Space};
use super::transfer::Joining;

/// Sharpness beyond these is 0 and 1, as VTK's `vtkPiecewiseFunction` has it.
const SHARPNESS: [f64; 2] = [0.01, 0.99];
/// Midpoints keep so far from the ends, as there.
const MIDPOINT: f64 = 1e-5;

/// Lines that stand for the path from one colour to the next: colours are off by less than 1e-3.
const STEPS: usize = 64;

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
    let colours = points(map, "RGBPoints")?;
    if colours.is_empty() {
        return Err("there is no list RGBPoints of numbers".into());
    }
    let opacities = points(map, "Points")?;
    if let Some([_, opacity, ..]) = opacities.iter().find(|p| !(0.0..=1.0).contains(&p[1])) {
        return Err(format!("Points: the opacity {opacity} is not within 0 and 1"));
    }
    let stretched = |points: &[[f64; 4]]| {
        let (first, last) = (points.first().map_or(0.0, |p| p[0]), points.last().map_or(1.0, |p| p[0]));
        move |at: f64| low + if last > first { (at - first) / (last - first) } else { 0.0 } * (high - low)
    };
    let span = stretched(&opacities);
    let opacity = if joining == Joining::Linear { shaped(&opacities) } else { plain(&opacities) };
    let join = Join::of(map, &colours, (low, high));
    let others = json.as_array().map_or(0, |maps| maps.len().saturating_sub(1));
    Ok(Map {
        colour: join.points(&colours, joining),
        opacity: opacity.into_iter().map(|(at, value)| (span(at), value)).collect(),
        note: note(map, &join, &opacities, others),
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

/// How colours are joined, and where their points lie among the data values.
struct Join {
    space: Space,
    /// Whether the map asks for a space that is not known.
    unknown: Option<String>,
    /// Whether points are spread by the logarithms of their values, and whether that was asked for.
    log: bool,
    asked_log: bool,
    /// The first and last value in the file, and those in the data.
    ends: [(f64, f64); 2],
}

impl Join {
    fn of(map: &Value, colours: &[[f64; 4]], domain: (f64, f64)) -> Self {
        let ends = (colours.first().map_or(0.0, |p| p[0]), colours.last().map_or(1.0, |p| p[0]));
        let name = map.get("ColorSpace").and_then(Value::as_str).unwrap_or("RGB");
        let found = Space::named(name, map.get("HSVWrap").is_none_or(is_set));
        // The differences of CIEDE2000 are near those of CIELAB.
        let space = found.unwrap_or(if name.starts_with("Lab") { Space::Lab } else { Space::Rgb });
        let asked_log = map.get("UseLogScale").is_some_and(is_set);
        let log = asked_log && ends.0 > 0.0 && domain.0 > 0.0;
        let unknown = found.is_none().then(|| name.to_owned());
        Self { space, unknown, log, asked_log, ends: [ends, domain] }
    }

    /// How far a value of the file is on the way from the first to the last.
    fn share(&self, value: f64) -> f64 {
        let (first, last) = self.ends[0];
        match last > first {
            true if self.log => (value / first).ln() / (last / first).ln(),
            true => (value - first) / (last - first),
            false => 0.0,
        }
    }

    /// The data value at a share of the way.
    fn place(&self, share: f64) -> f64 {
        let (low, high) = self.ends[1];
        if self.log { low * (high / low).powf(share) } else { low + share * (high - low) }
    }

    fn points(&self, colours: &[[f64; 4]], joining: Joining) -> Vec<(f64, Rgb)> {
        let colour = |p: &[f64; 4]| [p[1], p[2], p[3]];
        let straight = self.space == Space::Rgb && !self.log;
        let mut found = Vec::new();
        for (k, point) in colours.iter().enumerate() {
            let (from, at) = (colour(point), self.share(point[0]));
            found.push((self.place(at), from));
            let Some(next) = colours.get(k + 1).filter(|_| joining == Joining::Linear && !straight) else {
                continue;
            };
            let (to, end) = (colour(next), self.share(next[0]));
            if self.space == Space::Step {
                found.push((self.place(at).next_up(), to));
                continue;
            }
            found.extend((1..STEPS).map(|step| {
                let way = step as f64 / STEPS as f64;
                (self.place(at + way * (end - at)), self.space.between(from, to, way))
            }));
        }
        found
    }
}

/// What JSON has for true, a number other than 0 too.
fn is_set(value: &Value) -> bool {
    value.as_bool().unwrap_or_else(|| value.as_f64().is_some_and(|n| n != 0.0))
}

/// What a map, and a file with others beside it, asks for that is not followed.
fn note(map: &Value, join: &Join, opacities: &[[f64; 4]], others: usize) -> Option<String> {
    let joined = opacities.split_last().map_or(&[][..], |(_, joined)| joined);
    let bent = joined.iter().any(|p| (SHARPNESS[0]..=SHARPNESS[1]).contains(&p[3]));
    let name = map.get("Name").and_then(Value::as_str).unwrap_or_default();
    let instead = if join.space == Space::Lab { "Lab" } else { "RGB" };
    let notes = [
        join.unknown.as_ref().map(|space| format!("ColorSpace {space} (colours are joined in {instead})")),
        (join.asked_log && !join.log)
            .then(|| "UseLogScale (values are spread evenly, as some are not above 0)".into()),
        bent.then(|| "sharpness between 0 and 1 (opacities are joined by lines)".into()),
        (others > 0).then(|| format!("{others} further maps (the first is taken: {name})")),
    ];
    let notes: Vec<String> = notes.into_iter().flatten().collect();
    (!notes.is_empty()).then(|| format!("not followed: {}", notes.join(", ")))
}

/// Points of four numbers each, in the order of their values as VTK has them; none without such a list.
fn points(map: &Value, name: &str) -> Result<Vec<[f64; 4]>, String> {
    let Some(list) = map.get(name).filter(|list| !list.is_null()) else { return Ok(Vec::new()) };
    let list: Option<Vec<f64>> = list.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
    let list = list.filter(|list| list.len() % 4 == 0);
    let mut points =
        list.ok_or_else(|| format!("{name}: not a list of four numbers a point"))?.as_chunks().0.to_vec();
    points.sort_by(|a: &[f64; 4], b| a[0].total_cmp(&b[0]));
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::super::transfer::Curve;
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
        for bad in ["[0, 1, 0.5]", "\"x\"", "[0, 0, 0.5, null]", "{}", "3"] {
            let text = format!(r#"{{"RGBPoints": [0, 1, 1, 1], "Points": {bad}}}"#);
            let error = parse(&text, (0.0, 1.0), Joining::Linear).unwrap_err();
            assert!(error.starts_with("Points: "), "{bad}: {error}");
        }
        for none in ["null", "[]"] {
            let text = format!(r#"{{"RGBPoints": [0, 1, 1, 1], "Points": {none}}}"#);
            assert!(parse(&text, (0.0, 1.0), Joining::Linear).unwrap().opacity.is_empty());
        }
        let turned = r#"{"Points": [1, 0.9, 0.5, 0, 0, 0.1, 0.5, 0],
            "RGBPoints": [20, 1, 1, 1, 15, 0.4, 0.5, 0.6, 10, 0.1, 0.2, 0.3]}"#;
        let turned = parse(turned, (100.0, 300.0), Joining::Linear).unwrap();
        assert_eq!((turned.colour, turned.opacity), (map.colour, vec![(100.0, [0.1]), (300.0, [0.9])]));
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
    fn colours_are_joined_as_the_map_says() {
        let text = r#"{"ColorSpace": "Step", "RGBPoints": [1, 1, 0, 0, 10, 0, 1, 0, 100, 0, 0, 1]}"#;
        let curve = |text: &str, domain, joining| {
            let map = parse(text, domain, joining).unwrap();
            assert_eq!(map.note, None);
            Curve::new(map.colour, joining).unwrap()
        };
        let step = curve(text, (1.0, 100.0), Joining::Linear);
        assert_eq!([0.5, 2.0, 9.9, 11.0].map(|at| step.at(at)[2]), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!([2.0, 9.9, 10.0].map(|at| step.at(at)[1]), [1.0; 3]);
        let text = text.replace("\"Step\"", "\"RGB\", \"UseLogScale\": true");
        let log = curve(&text, (1.0, 100.0), Joining::Linear);
        for (at, red) in [(1.0, 1.0), (10_f64.sqrt(), 0.5), (2.0, 1.0 - 2_f64.log10())] {
            assert!((log.at(at)[0] - red).abs() < 1e-3, "{at} {:?}", log.at(at));
        }
        // Stretched over other data, the points are spread by logarithms all the same.
        assert!((curve(&text, (4.0, 64.0), Joining::Linear).at(16.0)[1] - 1.0).abs() < 1e-9);
        let constant = curve(&text.replace("RGB\"", "Lab\""), (1.0, 100.0), Joining::Constant);
        assert_eq!(constant.at(9.0), [1.0, 0.0, 0.0]);
        let diverging =
            r#"{"ColorSpace": "Diverging", "RGBPoints": [0, 0.231, 0.298, 0.753, 1, 0.706, 0.016, 0.149]}"#;
        let grey = curve(diverging, (0.0, 1.0), Joining::Linear).at(0.5);
        assert!(grey.iter().all(|part| (part - 0.865).abs() < 1e-3), "{grey:?}");
    }

    #[test]
    fn what_is_not_followed_is_told() {
        let text = r#"[{"ColorSpace": "Lab/CIEDE2000", "Name": "warm", "UseLogScale": 1, "RGBPoints": [0, 1, 1, 1],
            "Points": [0, 0.2, 0.5, 0.5, 4, 0.6, 0.5, 0]}, {}, {}]"#;
        let note = parse(text, (0.0, 8.0), Joining::Linear).unwrap().note.unwrap();
        for part in [
            "ColorSpace Lab/CIEDE2000 (colours are joined in Lab)",
            "UseLogScale",
            "sharpness",
            "2 further maps",
            "warm",
        ] {
            assert!(note.contains(part), "{part}: {note}");
        }
        let plain = text
            .replace("Lab/CIEDE2000", "RGB")
            .replace("Scale\": 1", "Scale\": 0")
            .replace("0.5, 0.5", "0.5, 0");
        let note = parse(&plain.replace(", {}, {}", ""), (0.0, 8.0), Joining::Linear).unwrap().note;
        assert_eq!(note, None);
    }
}
