//! Scenes: read, said again, prepared and rendered in a few pixels.

use std::sync::Arc;

use lacuna_volume::{Limits, Scene};

/// Bytes of memory.
const MOST: u64 = 8 << 20;

/// The bytes are a scene.
pub fn body(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let Ok(scene) = Scene::parse(&text, &[]) else { return };
    assert!(!scene.line().contains('\n'));
    let _ = lacuna_volume::files(&scene, super::folder());
    let limits = Limits { bytes: MOST, outside: false };
    let Ok(stage) = lacuna_volume::prepare(&scene, super::folder(), &limits) else { return };
    let camera = stage.camera(1);
    let _ = camera.as_ref().map(|camera| stage.shader(camera));
    let _ = Arc::new(stage);
}
