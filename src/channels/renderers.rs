//! What names are that renderers and compositors give, each with the reason.

use lacuna_exr::Part;

use super::geometry::{is_albedo, is_coordinate, is_motion, is_position};
use super::rules::{by_default, is_label, is_light, motion_axis};
use super::{Rule, is_matte};
use crate::testing::{float, part, window};

/// What a channel is: its kind, the reason for it, and layers; what stands after the last full stop are its components.
type Row = (&'static str, &'static str, &'static [&'static str]);

const TABLE: &[Row] = &[
    (
        "light",
        "the colour itself",
        &["R|G|B", "RGBA.R|G|B", "ViewLayer.Combined.R|G|B", "Ci.r|g|b", "C.R|G|B"],
    ),
    (
        "light",
        "a light group is called after its light, and lights after their kind or place",
        &[
            "RGBA_pointLight1.R|G|B",
            "point_light.R|G|B",
            "ViewLayer.Combined_point.R|G|B",
            "ViewLayer.Combined_position.R|G|B",
            "lgt_position_key.R|G|B",
            "beauty_point.R|G|B",
            "RGBA_N.R|G|B",
            "N_key.R|G|B",
            "uv_light.R|G|B",
            "spotlight_velocity.R|G|B",
            "point_light.left.R|G|B",
            "lgt_position.right.R|G|B",
            "RADIANCE_GROUP_0.R|G|B",
            "Light pass 1.R|G|B",
        ],
    ),
    (
        "light",
        "words of motion with another word: an effect",
        &[
            "motion_trail.R|G|B",
            "motion_blur.R|G|B",
            "vector_glow.R|G|B",
            "C_motion_blur.R|G|B",
            "flow_particles.R|G|B",
        ],
    ),
    (
        "light",
        "the end of an ordinal is no texture coordinate",
        &["1st_bounce.R|G|B", "1stBounce.R|G|B", "1st.R|G|B"],
    ),
    (
        "light",
        "seen through air, or blurred: no distance",
        &["depth_fog.R|G|B", "depth_of_field.R|G|B", "Mist.Z"],
    ),
    (
        "light",
        "light of what an identifier chooses (LuxCore, V-Ray)",
        &[
            "BY_OBJECT_ID_2.R|G|B",
            "BY_MATERIAL_ID_2.R|G|B",
            "VRayLightSelect_ID_3.R|G|B",
            "VRayObjectSelect_ID_3.R|G|B",
        ],
    ),
    (
        "light",
        "masks in three colours (V-Ray, LuxCore's files)",
        &["MultiMatte_ID.R|G|B", "OBJECT_ID_MASK_1.R|G|B"],
    ),
    ("matte", "LuxCore's antialiased masks of an identifier", &["OBJECT_ID_MASK_1", "MATERIAL_ID_MASK_0"]),
    (
        "light",
        "passes of Cycles, Arnold, Redshift, Octane, Corona, Karma",
        &[
            "ViewLayer.Glossy Direct.R|G|B",
            "volume_direct.R|G|B",
            "DiffuseLightingRaw.R|G|B",
            "Sunlight.R|G|B",
            "CEssential_Direct.R|G|B",
            "directglossyreflection.r|g|b",
            "shadow_matte.R|G|B",
        ],
    ),
    (
        "albedo",
        "the surface's colour",
        &["albedo.r|g|b", "ViewLayer.Denoising Albedo.R|G|B", "denoise_albedo.R|G|B"],
    ),
    (
        "statistic",
        "RenderMan's denoiser: variances are no normals, no depths, no albedo, and guide nothing",
        &[
            "normal_var.x|y|z",
            "normal_mse.x|y|z",
            "normal_var.r|g|b",
            "albedo_var.r|g|b",
            "depth_var.z",
            "zfiltered_var",
        ],
    ),
    (
        "normal",
        "axes",
        &[
            "N.X|Y|Z",
            "ViewLayer.Denoising Normal.X|Y|Z",
            "sh_normal.X|Y|Z",
            "Ns.X|Y|Z",
            "N.left.X|Y|Z",
            "right.N.X|Y|Z",
            "Light.Normal.X|Y|Z",
        ],
    ),
    (
        "normal",
        "RenderMan and Karma say the space or the hit in the word",
        &[
            "Nn.x|y|z",
            "Ngn.x|y|z",
            "Nworld.x|y|z",
            "__Nworld.x|y|z",
            "__Nref.x|y|z",
            "hitN.x|y|z",
            "ray:hitN.x|y|z",
        ],
    ),
    (
        "normal",
        "as a colour: V-Ray, LuxCore, Octane, Redshift, Corona, Unreal, files taken as layers",
        &[
            "VRayNormals.R|G|B",
            "BumpNormals.R|G|B",
            "SHADING_NORMAL.R|G|B",
            "Geometric normal.R|G|B",
            "CGeometry_NormalsShading.R|G|B",
            "FinalImageWorldNormal.R|G|B",
            "N.R|G|B",
            "N_cam.R|G|B",
            "N world.R|G|B",
        ],
    ),
    (
        "position",
        "of points in space; Px beside Py and Pz is pbrt's",
        &[
            "P.X|Y|Z",
            "Px|Py|Pz",
            "pos.X|Y|Z",
            "Pref.X|Y|Z",
            "ViewLayer.Position.X|Y|Z",
            "Pworld.x|y|z",
            "__Pworld.x|y|z",
            "ray:hitP.x|y|z",
            "Position_Screen.X|Y|Z",
        ],
    ),
    (
        "position",
        "as a colour: Nuke, Arnold, LuxCore, Redshift, Corona",
        &[
            "P.red|green|blue",
            "P.R|G|B",
            "POSITION.R|G|B",
            "WorldPosition.R|G|B",
            "CGeometry_WorldPosition.R|G|B",
            "worldPos.R|G|B",
            "point.R|G|B",
        ],
    ),
    (
        "texture",
        "the layer is called so",
        &[
            "uv.U|V",
            "UVs.R|G",
            "UV.R|G",
            "st.s|t",
            "ViewLayer.UV.X|Y",
            "texcoord.R|G",
            "UV coordinate.R|G|B",
            "__st.r|g",
        ],
    ),
    (
        "motion",
        "vectors: Arnold, Cycles, Karma, V-Ray, Unreal, RenderMan",
        &[
            "motionvector.X|Y",
            "ViewLayer.Vector.X|Y|Z|W",
            "motionvectors.x|y",
            "VRayVelocity.R|G|B",
            "FinalImageMotionVectors.R|G",
            "Motion vector.R|G",
            "motion.R|G",
            "forward.x|y",
            "backward.x|y",
            "motionBack.x|y",
            "right.Vector.X|Y",
        ],
    ),
    (
        "depth",
        "a Z without X, wherever it stands in the name: Arnold, Mantra, Karma, RenderMan",
        &["Z", "ZBack", "volume_Z", "Pz", "hitPz", "ray:hitPz", "zfiltered", "z|zback", "beauty.Z"],
    ),
    (
        "depth",
        "called so",
        &[
            "VRayZDepth",
            "dd.y",
            "distance",
            "Z_noisy",
            "ViewLayer.Depth.V",
            "Light.Depth.V",
            "DEPTH.R|G|B",
            "depth.left.R",
            "CGeometry_ZDepth.R",
            "FinalImageWorldDepth.R",
        ],
    ),
    (
        "identifier",
        "a pixel has one",
        &[
            "objectId",
            "VRayMtlID",
            "objectIDs",
            "VRayRenderID.R|G|B",
            "MATERIAL_ID",
            "materialId.R|G|B",
            "ViewLayer.IndexOB.V",
            "CMasking_ID.R",
            "Light pass ID.R|G|B",
            "light_index.R",
            "primid",
        ],
    ),
    ("count", "of samples", &["SAMPLECOUNT", "raycount.R", "ViewLayer.Debug Sample Count.X"]),
    ("other", "an effect's numbers", &["AA_inv_density", "cputime", "curvature.x"]),
];

/// The channels of a layer.
fn channels(layer: &str) -> Part {
    let (layer, components) = layer.rsplit_once('.').map_or(("", layer), |(layer, rest)| (layer, rest));
    let full = |one: &str| if layer.is_empty() { one.to_owned() } else { format!("{layer}.{one}") };
    part(window(0, 0, 1, 1), components.split('|').map(|one| float(&full(one), &[0.5])).collect())
}

fn kind(part: &Part, at: usize) -> &'static str {
    let name = part.channels[at].display_name();
    match by_default(part, at) {
        (Rule::Normal, _) => "normal",
        (Rule::Depth, _) => "depth",
        (Rule::Keep, _) => "count",
        (Rule::Nearest, _) if is_label(part, at) => "identifier",
        (Rule::Nearest, _) => "copied",
        _ if is_motion(&name) => "motion",
        _ if is_position(&name) => "position",
        _ if is_coordinate(&name) => "texture",
        _ if is_matte(&name) => "matte",
        _ if is_albedo(&name) => "albedo",
        _ if super::geometry::is_statistic(&name) => "statistic",
        (_, "colour" | "mist, a share of light") if is_light(&name) => "light",
        _ => "other",
    }
}

#[test]
fn names_of_renderers_are_what_they_say() {
    let mut wrong = Vec::new();
    for (expected, why, layers) in TABLE {
        for layer in *layers {
            let part = channels(layer);
            for at in 0..part.channels.len() {
                let found = kind(&part, at);
                if found != *expected {
                    wrong.push(format!("{layer}: {found}, no {expected} ({why})"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn what_is_no_motion_counts_no_pixels() {
    let axes = |layer: &str| {
        let part = channels(layer);
        (0..part.channels.len()).filter_map(|at| motion_axis(&part, at)).count()
    };
    for (layer, count) in [
        ("motion.R|G", 2),
        ("motion.X|Y|Z", 2),
        ("MotionVectors.R|G|B", 2),
        ("motionvector.x|y|z", 2),
        ("Vector.X|Y|Z|W", 4),
        ("forward.u|v", 2),
        ("motion.R|G|B", 0),
        ("motion_blur.R|G|B", 0),
        ("vector_displacement.X|Y|Z", 0),
        ("velocity.X|Y", 0),
    ] {
        assert_eq!(axes(layer), count, "{layer}");
    }
}
