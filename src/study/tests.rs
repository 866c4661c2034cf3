//! Studies on small frames: the same cells give the same rows, figures and verdicts say what the rows say.

use lacuna_filters::Method;
use lacuna_filters::baseline::{linear, nearest};

use super::*;
use crate::reconstruct::Job;
use crate::testing::{float, frame, part, window};

fn subject(name: &str, class: &str) -> Subject {
    let value = |k: usize| {
        (0..1024).map(|at| ((at % 32) as f32 / 9.0 + k as f32).sin().abs() * 0.7).collect::<Vec<f32>>()
    };
    let planes = [("B", 0), ("G", 1), ("R", 2)].map(|(name, k)| float(name, &value(k)));
    let frame = frame(vec![part(window(0, 0, 32, 32), planes.to_vec())]);
    let shots = vec![Shot { number: None, studied: true, sum: 7, frame }];
    Subject { name: name.into(), class: class.into(), shots, notes: Vec::new() }
}

fn entries() -> [Entry; 2] {
    let entry = |label: &str, method| Entry { label: label.into(), job: Job::new(method) };
    [entry("nearest", Method::from(nearest::Settings)), entry("linear", Method::from(linear::Settings))]
}

const TEXT: &str = "title = 'Small'\npatterns = ['random', 'shuffle']\ndensities = [0.2, 0.5]\nseeds = [1, 2]\n\
                    filters = ['nearest', 'linear']\n[[frames]]\nname = 'a'\nfile = 'a.exr'\nclass = 'smooth'\n";

fn rows() -> Vec<Row> {
    let (definition, subjects, entries) =
        (Definition::parse(TEXT).unwrap(), [subject("a", "smooth")], entries());
    cells(&definition, &subjects, &entries).unwrap().iter().map(|cell| run(cell, &mut |_| ())).collect()
}

#[test]
fn a_grid_is_every_frame_pattern_density_seed_and_filter() {
    let rows = rows();
    assert_eq!(rows.len(), 16);
    assert!(
        rows.iter().all(|row| row.error.is_none()
            && row.mse.is_some()
            && row.ssim.is_some()
            && row.cieluv.is_some())
    );
    let mut keys: Vec<&str> = rows.iter().map(|row| row.key.as_str()).collect();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), 16);
    for row in &rows {
        // The masks have within one row of pixels what was asked for.
        assert!((row.missing - (1.0 - row.density)).abs() < 1.0 / 32.0);
        // The error of the whole image is that of the missing pixels: the measured ones are exact.
        let (all, missing) = (row.mse.unwrap(), row.mse_missing.unwrap() * row.missing);
        assert!((all - missing).abs() <= 1e-12 * all.max(1e-3));
    }
    let psnr = |filter: &str, pattern: &str| -> f64 {
        rows.iter().filter(|row| row.filter == filter && row.pattern == pattern).filter_map(Row::psnr).sum()
    };
    assert!(psnr("linear", "shuffle") > psnr("nearest", "shuffle"));
    assert!(psnr("linear", "shuffle") > psnr("linear", "random"));
}

#[test]
fn a_journal_is_read_back_but_for_what_failed_or_was_cut() {
    let rows = rows();
    let failed = Row { error: Some("no".into()), ..rows[0].clone() };
    let text: String = rows.iter().chain([&failed]).map(journal).collect();
    let back = read_journal((text.clone() + &journal(&rows[0])[..40]).as_bytes());
    assert_eq!(back, rows);
    // A byte that is no text costs its own line and no other.
    let mut damaged = text.into_bytes();
    damaged[12] = 0xff;
    assert_eq!(read_journal(&damaged), rows[1..]);
    assert_eq!(csv(&rows).lines().count(), 17);
    let json: serde_json::Value = serde_json::from_str(&json("t", &rows).unwrap()).unwrap();
    assert!((json["rows"][3]["psnr"].as_f64().unwrap() - rows[3].psnr().unwrap()).abs() < 1e-9);
}

#[test]
fn equal_images_have_an_infinite_psnr_that_tables_and_verdicts_show_and_no_chart() {
    let rows: Vec<Row> = rows().into_iter().map(|row| Row { mse: Some(0.0), ..row }).collect();
    assert_eq!(rows[0].psnr(), Some(f64::INFINITY));
    let json: serde_json::Value = serde_json::from_str(&json("t", &rows).unwrap()).unwrap();
    assert_eq!(json["rows"][0]["psnr"], "inf");
    // What is left is the time.
    assert_eq!(figures(&rows).unwrap().len(), 1);
    let text = tables(&rows, Thresholds::default());
    assert!(text.contains("| a | linear | inf | inf |") && text.contains("**good throughout"), "{text}");
    // Beside others they change no line of a chart.
    let mut mixed = self::rows();
    let charts =
        |rows: &[Row]| figures(rows).unwrap().into_iter().map(|figure| figure.svg).collect::<Vec<_>>();
    mixed.retain(|row| row.density < 0.5);
    let before = charts(&mixed);
    let seconds = mixed[0].seconds;
    mixed.extend(rows.into_iter().filter(|row| row.density == 0.5).map(|row| Row { seconds, ..row }));
    let after = charts(&mixed);
    assert_eq!((&before[0], &before[2]), (&after[0], &after[2]));
}

/// Beside an edge pixels that are chosen in rounds are worth more than even ones, and than a first round that takes all of them.
#[test]
fn rounds_are_a_pattern_among_others() {
    let edge = |at: usize| if at % 48 + at / 96 < 30 { 0.2 } else { 0.9 };
    let values: Vec<f32> = (0..48 * 48).map(edge).collect();
    let frame = frame(vec![part(window(0, 0, 48, 48), vec![float("Y", &values)])]);
    let subjects = [Subject {
        shots: vec![Shot { number: None, studied: true, sum: 7, frame }],
        ..subject("a", "smooth")
    }];
    let text = TEXT.replace("'random', 'shuffle'", "'shuffle', 'adaptive rounds=4', 'adaptive first=1'");
    let definition = Definition::parse(&text).unwrap();
    let entries = entries();
    let rows: Vec<Row> =
        cells(&definition, &subjects, &entries).unwrap().iter().map(|cell| run(cell, &mut |_| ())).collect();
    assert!(rows.iter().all(|row| row.error.is_none()), "{:?}", rows[0].error);
    let psnr = |pattern: &str| -> f64 {
        rows.iter().filter(|row| row.filter == "linear" && row.pattern == pattern).filter_map(Row::psnr).sum()
    };
    assert!(psnr("adaptive rounds=4") > psnr("shuffle") + 4.0, "{}", psnr("adaptive rounds=4"));
    assert!(psnr("adaptive rounds=4") > psnr("adaptive first=1") + 4.0, "{}", psnr("adaptive first=1"));
}

#[test]
fn figures_have_axes_with_units_and_a_line_a_filter_and_pattern() {
    let rows = rows();
    let figures = figures(&rows).unwrap();
    let names: Vec<&str> = figures.iter().map(|figure| figure.name.as_str()).collect();
    assert_eq!(names, ["psnr-a", "seconds-a", "gain-a"]);
    for (figure, unit) in figures.iter().zip(["PSNR (dB)", "one thread (s)", "random (dB)"]) {
        for word in [unit, "missing pixels (%)", "nearest", "linear", figure.title.as_str()] {
            assert!(figure.svg.contains(word), "{}: {word}", figure.name);
        }
        roxmltree::Document::parse(&figure.svg).unwrap();
    }
    let polylines = |svg: &str| svg.matches("<polyline").count();
    assert!(polylines(&figures[0].svg) > polylines(&figures[2].svg));
}

#[test]
fn verdicts_follow_the_worst_frame() {
    let row = |frame: &str, filter: &str, missing: f64, psnr: f64| Row {
        frame: frame.into(),
        class: "c".into(),
        pattern: "shuffle".into(),
        density: 1.0 - missing,
        missing,
        filter: filter.into(),
        mse: Some(10_f64.powf(-psnr / 10.0)),
        ..Row::default()
    };
    let rows = [
        row("a", "ss", 0.1, 60.0),
        row("a", "ss", 0.5, 50.0),
        row("a", "ss", 0.9, 41.0),
        row("b", "ss", 0.1, 45.0),
        row("b", "ss", 0.5, 35.0),
        row("b", "ss", 0.9, 20.0),
        row("a", "tv", 0.1, 29.0),
        row("a", "tv", 0.5, 25.0),
        row("a", "tv", 0.9, 42.0),
        row("b", "tv", 0.1, 29.0),
        row("b", "tv", 0.5, 25.0),
        row("b", "tv", 0.9, 42.0),
    ];
    let texts: Vec<_> =
        verdicts(&rows, Thresholds::default()).into_iter().map(|v| (v.filter, v.text)).collect();
    let of = |filter: Option<&str>, text: &str| (filter.map(str::to_owned), text.to_owned());
    assert_eq!(
        texts,
        [
            of(Some("ss"), "good to 10 % missing, acceptable to 50 %"),
            of(Some("tv"), "not acceptable, even with 10 % missing"),
            of(None, "good to 10 % missing, acceptable beyond"),
        ]
    );
    let tables = tables(&rows, Thresholds::default());
    assert!(tables.contains("| c | a, b | **good to 10 % missing, acceptable beyond** |"));
    assert!(tables.contains("| a | ss | 60.00 | 50.00 | 41.00 |"));
}

/// `frame`, asked density, PSNR; none is a cell that failed.
fn judged(cells: &[(&str, f64, Option<f64>)]) -> Vec<Row> {
    let row = |&(frame, density, psnr): &(&str, f64, Option<f64>)| Row {
        frame: frame.into(),
        class: "a|b".into(),
        pattern: "shuffle".into(),
        density,
        missing: psnr.map_or(0.0, |_| 1.0 - density),
        filter: "ss".into(),
        mse: psnr.map(|psnr| 10_f64.powf(-psnr / 10.0)),
        error: psnr.is_none().then(|| "no".into()),
        ..Row::default()
    };
    cells.iter().map(row).collect()
}

#[test]
fn verdicts_count_cells_that_failed_and_densities_that_are_close() {
    let text =
        |cells: &[(&str, f64, Option<f64>)]| verdicts(&judged(cells), Thresholds::default())[0].text.clone();
    for (cells, expected) in [
        (&[("a", 0.6, Some(50.0)), ("a", 0.1, None)][..], "good to 40 % missing, fails at 90 %"),
        (
            &[("a", 0.9, Some(50.0)), ("a", 0.6, Some(35.0)), ("a", 0.1, None)],
            "good to 10 % missing, acceptable to 40 %, fails at 90 %",
        ),
        (&[("a", 0.6, Some(35.0)), ("a", 0.1, None)], "acceptable to 40 % missing, fails at 90 %"),
        (&[("a", 0.6, None), ("a", 0.1, Some(50.0))], "fails at 40 % missing"),
        (&[("a", 0.6, Some(50.0)), ("b", 0.6, None)], "fails at 40 % missing"),
        (
            &[("a", 0.02, Some(50.0)), ("a", 0.018, Some(20.0))],
            "good to 98.0 % missing, acceptable to 98.0 %",
        ),
    ] {
        assert_eq!(text(cells), expected);
    }
    let rows = judged(&[("a", 0.02, Some(50.0)), ("a", 0.018, None)]);
    let text = tables(&rows, Thresholds::default());
    assert!(text.contains("| frame | filter | 98.0 % | 98.2 % |"), "{text}");
    assert!(text.contains("| a\\|b | a | **good to 98.0 % missing, fails at 98.2 %** |"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&json("t", &rows).unwrap()).unwrap();
    assert!(json["rows"][1]["missing"].is_null() && json["rows"][1]["equal"].is_null());
    assert!(json["rows"][0]["missing"].is_number() && json["rows"][0]["equal"].is_number());
}

/// Sample type and attributes decide results as pixels do.
#[test]
fn a_sum_tells_all_that_decides_a_result() {
    let frame = subject("a", "c").shots.remove(0).frame;
    let part = &frame.parts[0];
    let mut camera = part.clone();
    camera.attributes.set("worldToCamera", "m44f", vec![1; 64]);
    let mut halves = part.clone();
    let floats = halves.channels.iter().map(|channel| channel.samples.as_f32());
    let kinds = floats.map(|values| crate::testing::half("x", &values).samples).collect::<Vec<_>>();
    halves.channels.iter_mut().zip(kinds).for_each(|(channel, samples)| channel.samples = samples);
    let mut rounded = halves.clone();
    for channel in &mut rounded.channels {
        channel.samples = float("x", &channel.samples.as_f32()).samples;
    }
    let sums = [part, &camera, &halves, &rounded].map(subject::sum);
    assert!((0..4).all(|a| (0..a).all(|b| sums[a] != sums[b])), "{sums:?}");
}

#[test]
fn legends_fit_and_no_two_styles_are_alike() {
    let names = |what: &str| (0..18).map(|k| format!("{what} with a long name {k}")).collect::<Vec<_>>();
    let chart = chart::Chart {
        title: "t".into(),
        x: "x",
        y: "y",
        log: false,
        span: (0.0, 1.0),
        names: names("filter"),
        styles: names("pattern"),
        lines: Vec::new(),
    };
    let svg = chart.svg().unwrap();
    let document = roxmltree::Document::parse(&svg).unwrap();
    let number =
        |node: roxmltree::Node<'_, '_>, name: &str| node.attribute(name).unwrap().parse::<f64>().unwrap();
    let root = document.root_element();
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    assert!(texts.clone().count() >= 36);
    assert!(texts.map(|text| number(text, "y")).all(|y| y + 8.0 < number(root, "height")));
    assert!(number(root, "width") > 560.0 + 42.0 + 28.0 * 7.5);
    let dashes: std::collections::BTreeSet<_> = (1..18).map(chart::dash).collect();
    assert_eq!(dashes.len(), 17);
}

#[test]
fn a_sheet_has_a_column_a_filter_and_pictures_inside() {
    let text = format!(
        "{TEXT}[[sheets]]\nname = 's'\nframe = 'a'\npattern = 'shuffle'\ndensities = [0.5]\ntile = 16\nwindow = [2, 3, 20, 10]\n"
    );
    let definition = Definition::parse(&text).unwrap();
    let (subjects, entries) = ([subject("a", "c")], entries());
    let own = Definition {
        patterns: vec!["shuffle".into()],
        densities: vec![0.5],
        seeds: vec![1],
        ..definition.clone()
    };
    let cells = cells(&own, &subjects, &entries).unwrap();
    let sheet = |tiles: &[Tile<'_>]| sheet(&definition.sheets[0], tiles);
    let tile = |cell| (cell, Sheet::of(cell, &definition.sheets[0]));
    let svg = sheet(&cells.iter().map(tile).collect::<Vec<_>>());
    let document = roxmltree::Document::parse(&svg).unwrap();
    let images: Vec<_> = document.descendants().filter(|node| node.has_tag_name("image")).collect();
    assert_eq!(images.len(), 2 + 3 * 2);
    assert!(images.iter().all(|image| image.attribute("href").is_some_and(|data| data.len() > 60)));
    assert!(svg.contains("PSNR") && svg.contains("mSSIM") && svg.contains("50 % missing"));
    // A cell that failed costs its own tile.
    let why = "no two neighbours are measured in a row, so that nothing is known: do otherwise";
    let svg = sheet(&[(&cells[0], Err(why.into())), tile(&cells[1])]);
    let document = roxmltree::Document::parse(&svg).unwrap();
    assert_eq!(document.descendants().filter(|node| node.has_tag_name("image")).count(), 2 + 3);
    let words: Vec<_> = document.descendants().filter_map(|node| node.text()).collect();
    assert!(words.contains(&"neighbours are"), "{words:?}");
    let svg = sheet(&[(&cells[0], Err(why.into())), (&cells[1], Err(why.into()))]);
    assert!(svg.contains("nearest") && !svg.contains("<image"));
}

#[test]
fn the_page_shows_everything_and_escapes_names() {
    let rows = rows();
    let definition = Definition { title: "A <b> study".into(), ..Definition::parse(TEXT).unwrap() };
    let html = page(
        &definition,
        &rows,
        &figures(&rows).unwrap(),
        &[("s".into(), "<svg><script>1</script></svg>".into())],
    );
    assert!(html.contains("src=\"data:image/svg+xml;base64,") && !html.contains("<script>1"));
    assert!(html.contains("A &lt;b&gt; study") && !html.contains("<b> study"));
    assert_eq!(html.matches("<tr><th scope=\"row\">a</th>").count(), 16);
    assert_eq!(html.matches("<figure").count(), 3);
    assert!(html.contains("best each time"));
}

#[test]
fn definitions_that_contradict_themselves_are_refused() {
    for (change, reason) in [
        (("[0.2, 0.5]", "[0.2, 0]"), "density 0"),
        (("[0.2, 0.5]", "[]"), "densities is empty"),
        (("'random'", "'rand'"), "there are random, shuffle"),
        (("name = 'a'", "name = 'a/b'"), "name 'a/b'"),
        (
            ("'random', 'shuffle'", "'adaptive rounds=2 first=0.5', 'adaptive first=0.50 rounds=2'"),
            "pattern 'adaptive rounds=2 first=0.5' is there twice",
        ),
        (("'linear'", "' nearest '"), "filter 'nearest' is there twice"),
        (
            (
                "[[frames]]",
                "[[sheets]]\nname = 's'\nframe = 'a'\npattern = 'grid'\ndensities = []\n[[frames]]",
            ),
            "sheet 's': densities is empty",
        ),
        (("title", "titel"), "titel"),
        (
            ("[[frames]]", "[verdict]\ngood = 30\nacceptable = 40\n[[frames]]"),
            "acceptable = 40 is above good = 30",
        ),
        (("[[frames]]", "[verdict]\ngood = nan\nacceptable = 40\n[[frames]]"), "no number"),
        (
            (
                "[[frames]]",
                "[[sheets]]\nname = 's'\nframe = 'z'\npattern = 'grid'\ndensities = [0.5]\n[[frames]]",
            ),
            "no frame 'z'",
        ),
    ] {
        let error = Definition::parse(&TEXT.replace(change.0, change.1)).unwrap_err().0;
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn a_crop_keeps_absolute_coordinates() {
    let mut whole = subject("a", "c").shots[0].frame.parts.remove(0);
    let before = crate::testing::values(&whole, "R");
    subject::crop(&mut whole, [4, 5, 3, 2]).unwrap();
    let after = crate::testing::values(&whole, "R");
    assert_eq!(after, [before[164], before[165], before[166], before[196], before[197], before[198]]);
    assert_eq!((whole.data_window.x_min, whole.data_window.y_max), (4, 6));
    for outside in [[4, 5, 3, 2], [3, 5, 3, 2], [4, 5, 4, 2], [4, 5, 0, 2]] {
        assert_eq!(subject::crop(&mut whole.clone(), outside).is_ok(), outside == [4, 5, 3, 2]);
    }
}

/// The rival is one row a frame, whatever densities, seeds and filters there are, in a table of its own; smooth pictures it hits well.
#[test]
fn half_the_resolution_is_a_row_beside_the_others() {
    let definition = Definition::parse(&TEXT.replace("'random', 'shuffle'", "'half', 'shuffle'")).unwrap();
    let (subjects, entries) = ([subject("a", "smooth")], entries());
    let cells = cells(&definition, &subjects, &entries).unwrap();
    let rows: Vec<Row> = cells.iter().map(|cell| run(cell, &mut |_| ())).collect();
    let half: Vec<&Row> = rows.iter().filter(|row| row.pattern == "half").collect();
    assert_eq!((rows.len(), half.len()), (9, 1));
    assert_eq!((half[0].filter.as_str(), half[0].missing, half[0].error.as_ref()), ("lanczos3", 0.75, None));
    assert!(half[0].psnr().unwrap() > 30.0, "{:?}", half[0].psnr());
    let text = tables(&rows, Thresholds::default());
    assert_eq!(text.matches("| a | lanczos3 |").count(), 2, "{text}");
    assert_eq!(text.matches("| a | nearest |").count(), 2, "{text}");
}
