//! Everything that the pixels of a frame depend on, on one line.

use lacuna_volume::Scene;

use super::RenderJob;
use crate::reconstruct::FILLED_BY;

/// The line of all frames, but for their numbers.
pub struct Settings {
    /// What is rendered.
    rendered: String,
    /// What fills the rest.
    filled: String,
}

impl Settings {
    /// Those of a scene.
    pub fn new(job: &RenderJob, scene: &Scene) -> Self {
        let pixels = job.pixels.pattern().unwrap_or_else(|| "all".into());
        let wanted = &job.wanted;
        let flags = [
            (wanted.depth, "depth"),
            (wanted.normals, "normals"),
            (wanted.samples, "samples"),
            (wanted.gradients, "gradients"),
            (wanted.dense, "dense-aovs"),
            (wanted.motion, "motion"),
        ];
        let layers: Vec<&str> = flags.iter().filter(|(on, _)| *on).map(|(_, name)| *name).collect();
        let (scene, layers, kind) = (scene.line(), layers.join("+"), wanted.kind);
        let rendered = format!("scene={scene} pixels={pixels} layers={layers} type={kind:?}");
        let fill = job.fill.as_ref().map_or("none", |method| method.name());
        let estimate = if job.estimate || job.fill.is_none() { "" } else { " estimate=none" };
        let level = job.level.map_or(String::new(), |level| format!(" compression-level={level}"));
        Self { rendered, filled: format!("{FILLED_BY}{fill}{estimate}{level}") }
    }

    /// The line of a frame; without a number, what all of them share.
    pub fn of(&self, number: Option<i64>) -> String {
        // Cameras that orbit, and pixels that are chosen, differ from frame to frame.
        let frame = number.map_or(String::new(), |number| format!(" frame={number}"));
        format!("{}{frame}{}", self.rendered, self.filled)
    }
}
