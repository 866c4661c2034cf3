//! Rules of many names, as renderers write them.

use lacuna_exr::Samples;

use super::*;
use crate::testing::{float, frame, half, part, uint, window};

/// A part of one pixel with float channels of those names.
fn with(names: &[&str]) -> Part {
    part(window(0, 0, 1, 1), names.iter().map(|name| float(name, &[0.5])).collect())
}

fn rule(part: &Part, name: &str) -> Rule {
    let at = part.channels.iter().position(|channel| channel.name == name.as_bytes()).unwrap();
    by_default(part, at).0
}

fn choices(part: Part, overrides: &[&str]) -> Vec<(String, Rule)> {
    let overrides: Vec<Override> = overrides.iter().map(|text| text.parse().unwrap()).collect();
    let frame = frame(vec![part]);
    let chosen = choose(&frame, &[], &overrides).remove(0);
    let names = frame.parts[0].channels.iter().map(|channel| channel.display_name().into_owned());
    names.zip(chosen).map(|(name, choice)| (name, choice.rule)).collect()
}

/// Names that decide alone.
const NAMES: &[(Rule, &str)] = &[
    (Rule::Fill, "R|G|B|A|Y|RY|fluid.R|bridge.R|Diffuse Direct.R|diffuse.red|ViewLayer.Combined.R|Albedo.R"),
    (
        Rule::Fill,
        "Variance.R|RelativeVariance.R|P.X|Px|pos.X|position.Y|uv.U|u|dzdx|whitebarmask.mask|solid.A",
    ),
    (Rule::Fill, "hidden.G|AR|grid.B|widget.r|forward_scatter.R|validity.R|normalized.R|depth_of_field.R"),
    (Rule::Fill, "Pref.X|video.R|mid.R|identity.R|amazing.R|beauty.alpha|cryptic.R|promotion.R"),
    (Rule::Nearest, "id|ID|objectId|material_id|objectid.R|ObjectID.X|VRayMtlID|VRayRenderID.R"),
    (Rule::Nearest, "ViewLayer.IndexOB.X|crypto_object00.red|CryptoObject00.r|ViewLayer.CryptoMaterial02.a"),
    (
        Rule::Fill,
        "forward.u|backward.v|motion.X|Vector.X|ViewLayer.Vector.W|velocity.R|motionvector.x|disparityL.x|flow.x",
    ),
    (Rule::Nearest, "cryptomatte01.R|uCryptoAsset.G|shape_index.Y|prim_index|nodeId3"),
    (Rule::Depth, "Z|z|ZBack|zback|depth.T|depth.R|Depth|ViewLayer.Depth.Z|VRayZDepth|camera_depth|beauty.Z"),
    (Rule::Fill, "ViewLayer.Mist.Z|mist"),
    (Rule::Nearest, "label|segmentation|labels.R|face_label"),
    (Rule::Keep, "nSamples|rayCount|stats.nSamples|rayCount.R"),
    (Rule::Depth, "depth.Z|deep.ZBack|zDepth.R|dd.y|Z_noisy|distance|distance.R"),
    (Rule::Nearest, "nodeIDs.R|objectIDs"),
    (Rule::Fill, "distance_fog.R|distance_light.G|noisy.R|UVs.R"),
    (Rule::Keep, "mask|Mask|MASK|samples|SAMPLECOUNT|SampleCount|stats.samples|sample_count"),
    (Rule::Keep, "ViewLayer.Debug Sample Count.X"),
];

#[test]
fn single_names() {
    for (expected, names) in NAMES {
        for name in names.split('|') {
            assert_eq!(rule(&with(&[name]), name), *expected, "{name}");
        }
    }
}

#[test]
fn few_values_that_repeat_exactly_are_labels() {
    let labels: Vec<f32> = (0..256).map(|at| [0.0, 0.25, 1.0, 7.5][at / 16 % 4]).collect();
    let ramp: Vec<f32> = (0..256).map(|at| at as f32 / 256.0).collect();
    let make = |values: &[f32]| {
        let names = ["R", "puzzle_matte.R", "region", "mask.matte", "uv.u", "density"];
        part(window(0, 0, 16, 16), names.map(|name| half(name, values)).to_vec())
    };
    let nearest = |part: &Part| -> Vec<String> {
        let names = part.channels.iter().map(|channel| channel.display_name().into_owned());
        names.filter(|name| rule(part, name) == Rule::Nearest).collect()
    };
    assert_eq!(nearest(&make(&labels)), ["density", "puzzle_matte.R", "region"]);
    assert_eq!(nearest(&make(&ramp)), [""; 0]);
    // One label alone, and a few samples of a ramp, are none.
    assert_eq!(nearest(&make(&[0.5; 256])), [""; 0]);
    let sparse: Vec<f32> = ramp.iter().map(|v| if v * 8.0 == (v * 8.0).floor() { *v } else { 0.0 }).collect();
    assert_eq!(nearest(&make(&sparse)), [""; 0]);
}

#[test]
fn normals_need_their_siblings() {
    for names in [
        ["N.X", "N.Y", "N.Z"],
        ["normal.x", "normal.y", "normal.z"],
        ["ViewLayer.Normal.X", "ViewLayer.Normal.Y", "ViewLayer.Normal.Z"],
        ["Ns.X", "Ns.Y", "Ns.Z"],
        ["VRayNormals.R", "VRayNormals.G", "VRayNormals.B"],
        ["bumpNormals.red", "bumpNormals.green", "bumpNormals.blue"],
        ["N_cam.X", "N_cam.Y", "N_cam.Z"],
        ["Nx", "Ny", "Nz"],
        ["normal_x", "normal_y", "normal_z"],
    ] {
        for name in names {
            assert_eq!(rule(&with(&names), name), Rule::Normal, "{name}");
        }
        assert_ne!(rule(&with(&names[..2]), names[0]), Rule::Normal, "{} alone", names[0]);
    }
    let with_alpha = with(&["N.X", "N.Y", "N.Z", "N.A"]);
    assert_eq!(rule(&with_alpha, "N.A"), Rule::Fill);
    assert_eq!(rule(&with_alpha, "N.Z"), Rule::Normal);
}

#[test]
fn z_is_a_component_where_x_is() {
    let vector = with(&["P.X", "P.Y", "P.Z", "Z"]);
    assert_eq!(rule(&vector, "P.Z"), Rule::Fill);
    assert_eq!(rule(&vector, "Z"), Rule::Depth);
    assert_eq!(rule(&with(&["X", "Y", "Z"]), "Z"), Rule::Fill);
}

#[test]
fn coordinates_have_one_reason() {
    let part = with(&["uv.x", "uv.y", "Y"]);
    let reason = |name: &str| {
        let at = part.channels.iter().position(|channel| channel.name == name.as_bytes()).unwrap();
        by_default(&part, at)
    };
    assert_eq!(reason("uv.x"), reason("uv.y"));
    assert_eq!(reason("Y"), (Rule::Fill, "colour"));
}

#[test]
fn beside_the_mask_others_are_mattes() {
    let part = with(&["MASK", "mask"]);
    assert_eq!((rule(&part, "MASK"), rule(&part, "mask")), (Rule::Fill, Rule::Keep));
}

#[test]
fn whole_numbers_are_copied_and_never_computed() {
    let make = || part(window(0, 0, 1, 1), vec![uint("R", &[7]), half("G", &[0.5])]);
    assert_eq!(choices(make(), &[]), [("G".into(), Rule::Fill), ("R".into(), Rule::Nearest)]);
    assert_eq!(choices(make(), &["*=fill"])[1].1, Rule::Nearest);
    assert_eq!(choices(make(), &["R=keep"])[1].1, Rule::Keep);
    assert!(matches!(make().channels[1].samples, Samples::Uint(_)));
}

#[test]
fn cryptomatte_by_its_attributes() {
    let mut part = with(&["Asset00.R", "Asset.R", "Assets.R", "AssetX00.R"]);
    part.attributes.set_text("cryptomatte/1a2b3c4/name", "Asset");
    assert_eq!(rule(&part, "Asset00.R"), Rule::Nearest);
    assert_eq!(rule(&part, "Asset.R"), Rule::Nearest);
    assert_eq!(rule(&part, "Assets.R"), Rule::Fill);
    assert_eq!(rule(&part, "AssetX00.R"), Rule::Fill);
}

#[test]
fn cryptomatte_of_a_view_and_of_another_part() {
    let mut stereo = with(&["Asset00.right.R", "right.Asset01.G", "Asset00.top.R"]);
    stereo.attributes.set_text("cryptomatte/1a2b3c4/name", "Asset");
    let views = ["left", "right"]
        .iter()
        .flat_map(|view| [&(view.len() as u32).to_le_bytes(), view.as_bytes()].concat());
    stereo.attributes.set("multiView", "stringvector", views.collect());
    let rules = choices(stereo.clone(), &[]);
    let listed: Vec<_> =
        rules.iter().filter(|(_, rule)| *rule == Rule::Nearest).map(|(name, _)| name.as_str()).collect();
    assert_eq!(listed, ["Asset00.right.R", "right.Asset01.G"]);
    let apart = frame(vec![stereo, with(&["Asset00.R", "R"])]);
    let apart: Vec<_> = choose(&apart, &[], &[])[1].iter().map(|choice| choice.rule).collect();
    assert_eq!(apart, [Rule::Nearest, Rule::Fill]);
}

#[test]
fn overrides_come_first_and_the_first_wins() {
    let make = || with(&["Diffuse Direct.R", "R", "id.R", "mask"]);
    let rules: Vec<_> =
        choices(make(), &["Diff*=keep", "*.R=depth", "mask=fill"]).into_iter().map(|c| c.1).collect();
    assert_eq!(rules, [Rule::Keep, Rule::Fill, Rule::Depth, Rule::Fill]);
    assert_eq!(choices(make(), &["[Rm]*=nearest"])[1].1, Rule::Nearest);
}

#[test]
fn the_mask_in_use_is_kept_whatever_is_asked() {
    let frame = frame(vec![with(&["R", "mask"])]);
    let mask_channels = vec![vec![1]];
    let choices = choose(&frame, &mask_channels, &["*=fill".parse().unwrap()]);
    assert_eq!(choices[0][1].rule, Rule::Keep);
    assert_eq!(choices[0][0].rule, Rule::Fill);
}

#[test]
fn normals_that_are_asked_for_need_three() {
    let asked = choices(with(&["dir.X", "dir.Y", "dir.Z", "two.X", "two.Y"]), &["*=normal"]);
    let rules: Vec<_> = asked.into_iter().map(|choice| choice.1).collect();
    assert_eq!(rules, [Rule::Normal, Rule::Normal, Rule::Normal, Rule::Fill, Rule::Fill]);
    let broken = choices(with(&["N.X", "N.Y", "N.Z"]), &["N.Y=keep"]);
    assert_eq!(broken.iter().map(|c| c.1).collect::<Vec<_>>(), [Rule::Fill, Rule::Keep, Rule::Fill]);
}

#[test]
fn what_is_asked_in_vain_is_told() {
    let mut channels = vec![float("R", &[0.5]), float("N.X", &[0.5]), float("mask", &[1.0])];
    channels.push(uint("id", &[1]));
    let frame = frame(vec![part(window(0, 0, 1, 1), channels)]);
    let at = frame.parts[0].channels.iter().position(|channel| channel.name == b"mask").unwrap();
    let mask_channels = vec![vec![at]];
    let told = |texts: &[&str]| {
        let overrides: Vec<Override> = texts.iter().map(|text| text.parse().unwrap()).collect();
        unheeded(&frame, &mask_channels, &overrides, &choose(&frame, &mask_channels, &overrides)).join("; ")
    };
    for (texts, expected) in [
        (&["*=nearest"] as &[&str], ""),
        (&["R=keep", "mask=keep"], ""),
        (&["r=fill"], "--channels 'r=fill': no channel matches"),
        (&["mask=fill"], "--channels 'mask=fill': the sampling mask in use is always kept"),
        (&["*=keep", "R=fill"], "--channels 'R=fill': an earlier --channels matches the same channels"),
        (&["id=fill"], "--channels 'id=fill': id has whole numbers, which are copied from the nearest pixel"),
        (
            &["N.X=normal"],
            "--channels 'N.X=normal': N.X: not all three siblings are there, so it is filled as it is",
        ),
    ] {
        assert_eq!(told(texts), expected);
    }
}

#[test]
fn complete_channels_that_are_none_are_told() {
    let mut part = with(&["R", "Z"]);
    part.attributes.set_text(DENSE, "Z, albedo.R\nN.X");
    let frame = frame(vec![part]);
    let choices = choose(&frame, &[], &[]);
    let told = unheeded(&frame, &[], &[], &choices);
    assert_eq!(told, ["the attribute lacuna/dense lists albedo.R, N.X, which is no channel here"]);
}

#[test]
fn overrides_have_one_equals_sign() {
    let error = |text: &str| text.parse::<Override>().unwrap_err();
    assert_eq!(error("R=keep=fill"), OverrideError::Doubled("R=keep=fill".into()));
    assert!(error("R=what").to_string().contains("choose fill, normal, depth, nearest or keep"));
    assert!("a[=]b=fill".parse::<Override>().unwrap().matches("a=b"));
}

#[test]
fn dense_channels_are_kept() {
    let mut part = with(&["Diffuse Direct.R", "R", "Z"]);
    part.attributes.set_text(DENSE, "Z, Diffuse Direct.R");
    let rules: Vec<_> = choices(part, &[]).into_iter().map(|choice| choice.1).collect();
    assert_eq!(rules, [Rule::Keep, Rule::Fill, Rule::Keep]);
}

#[test]
fn lists_of_complete_channels_may_have_names_with_commas() {
    let names = ["Z", "depth, near", "albedo.R"];
    let mut part = with(&names);
    for text in ["Z\ndepth, near\nalbedo.R", "Z,albedo.R\n depth, near \n"] {
        part.attributes.set_text(DENSE, text);
        let mut found = dense(&part);
        found.sort();
        assert_eq!(found, ["Z", "albedo.R", "depth, near"]);
    }
    part.attributes.set_text(DENSE, "");
    list_dense(&mut part, ["Z", "albedo.R"]);
    assert_eq!(part.attributes.text(DENSE).as_deref(), Some("Z,albedo.R"));
    list_dense(&mut part, ["depth, near"]);
    assert_eq!(dense(&part), ["Z", "albedo.R", "depth, near"]);
    part.attributes.set_text(DENSE, "");
    list_dense(&mut part, ["depth, near"]);
    assert_eq!(dense(&part), ["depth, near"]);
}

#[test]
fn overrides_say_what_is_wrong_with_them() {
    for text in ["", "R", "=fill", "R=paint", "[=fill"] {
        let error = text.parse::<Override>().unwrap_err().to_string();
        assert!(!error.contains('\n') && !error.is_empty(), "{text}: {error}");
    }
    assert_eq!("a[=]b=keep".parse::<Override>().unwrap().to_string(), "a[=]b=keep");
}
