//! Tests of the files that masks become.

use lacuna_exr::Limits;
use lacuna_filters::Size;
use lacuna_filters::sampling::{Pattern, Temporal};

use super::*;
use crate::mask::generate::{self, Bounds, Request};
use crate::testing::window;

const REQUEST: Request = Request {
    window: Window { x_min: -5, y_min: 3, x_max: 15, y_max: 12 },
    pattern: Pattern::Shuffle,
    density: 0.3,
    seed: 1,
    temporal: Temporal::Fixed,
    paired: false,
};

fn write(name: &str, mask: &Mask) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let listing = Listing::Rank(generate::order(&REQUEST, 0));
    let how = Writing { overhead: 4, ..Writing::default() };
    write_mask(&path, mask, REQUEST.window, &listing, &how).unwrap();
    (folder, path)
}

#[test]
fn images_hold_the_mask_and_its_window() {
    let mask = generate::generate(&REQUEST, 0, &Bounds::default()).unwrap();
    for name in ["m.exr", "m.png"] {
        let (_folder, path) = write(name, &mask);
        assert_eq!(generate::load(path.to_str().unwrap(), None, Limits::default()).unwrap(), mask, "{name}");
    }
    let (_folder, path) = write("m.exr", &mask);
    let frame = lacuna_exr::read(&path, &Limits::default()).unwrap();
    assert_eq!(frame.parts[0].data_window, REQUEST.window);
    assert_eq!(frame.parts[0].attributes.text(ATTRIBUTE).as_deref(), Some("mask"));
}

#[test]
fn a_list_is_in_progressive_order() {
    let mask = generate::generate(&REQUEST, 0, &Bounds::default()).unwrap();
    let (_folder, path) = write("m.txt", &mask);
    let text = std::fs::read_to_string(path).unwrap();
    let points: Vec<(usize, usize)> = text
        .lines()
        .map(|line| {
            let (x, y) = line.split_once(' ').unwrap();
            ((y.parse::<i32>().unwrap() - 3) as usize, (x.parse::<i32>().unwrap() + 5) as usize)
        })
        .collect();
    assert_eq!(points.len(), mask.count());
    assert!(points.iter().all(|&(row, column)| mask.is_measured(row, column)));
    let rank = generate::order(&REQUEST, 0);
    assert!(points.windows(2).all(|pair| rank(pair[0].0, pair[0].1) < rank(pair[1].0, pair[1].1)));
    // The first lines are the mask of a smaller density.
    let small = generate::generate(&Request { density: 0.1, ..REQUEST }, 0, &Bounds::default()).unwrap();
    assert!(points[..small.count()].iter().all(|&(row, column)| small.is_measured(row, column)));
}

#[test]
fn rectangles_are_json() {
    let mask = generate::generate(&REQUEST, 0, &Bounds::default()).unwrap();
    let (_folder, path) = write("m.json", &mask);
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    assert_eq!((json["width"].as_u64(), json["x"].as_i64()), (Some(21), Some(-5)));
    assert!(json["coverage"].as_f64() >= json["density"].as_f64());
    assert!(!json["rectangles"].as_array().unwrap().is_empty());
}

#[test]
fn floats_are_images() {
    let folder = tempfile::tempdir().unwrap();
    let values = vec![0.0, 0.25, 0.5, 1.0];
    let small = window(0, 0, 2, 2);
    let path = folder.path().join("e.png");
    write_floats(&path, "error", values.clone(), 1.0, small, &Writing::default()).unwrap();
    let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
    assert_eq!(crate::raster::read_grey(file, 1 << 20).unwrap().values, [0, 16384, 32768, 65535]);
    let path = folder.path().join("e.exr");
    write_floats(&path, "error", values.clone(), 1.0, small, &Writing::default()).unwrap();
    let frame = lacuna_exr::read(&path, &Limits::default()).unwrap();
    assert_eq!(frame.parts[0].channels[0].samples, Samples::Float(values.clone()));
    let error = write_floats(&folder.path().join("e.txt"), "error", values, 1.0, small, &Writing::default());
    assert!(error.unwrap_err().to_string().contains("write .exr or .png"));
}

#[test]
fn smallest_and_empty_masks_are_written() {
    for (size, flag) in [(Size::new(1, 1), false), (Size::new(1, 1), true), (Size::new(1, 9), true)] {
        let folder = tempfile::tempdir().unwrap();
        let mask = Mask::from_fn(size, |_, _| flag);
        for name in ["a.exr", "a.png", "a.txt", "a.json"] {
            let path = folder.path().join(name);
            let listing = Listing::Rank(Box::new(|_, _| 0.0));
            let window = window(0, 0, size.width as i32, size.height as i32);
            write_mask(&path, &mask, window, &listing, &Writing::default()).unwrap();
            assert!(path.exists());
        }
        let text = std::fs::read_to_string(folder.path().join("a.txt")).unwrap();
        assert_eq!(text.lines().count(), mask.count());
    }
    assert!(Format::of(Path::new("mask.tif")).is_err());
}

#[test]
fn tiny_errors_have_all_greys() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.png");
    let values: Vec<f32> = (0..210).map(|k| k as f32 * 1e-38).collect();
    write_floats(&path, "error", values, 209e-38, REQUEST.window, &Writing::default()).unwrap();
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    let greys: Vec<u16> = bytes.chunks_exact(2).map(|two| u16::from_be_bytes([two[0], two[1]])).collect();
    assert!(greys.windows(2).all(|pair| pair[0] < pair[1]) && greys[209] == 65535, "{greys:?}");
}
