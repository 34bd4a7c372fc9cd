//! Draws one frame of the built-in scene without a window and writes it as PNG: `cargo run --release -p kernels --example render_png -- frame.png`.

use std::path::{Path, PathBuf};

use kernels::frame::export::write_png;
use kernels::scene::{self, Scene};
use kernels::view::camera::Pose;
use kernels::{Gpu, RenderRequest, Renderer, Result};

/// Draws `scene` as its first camera sees it and writes the picture to `file`.
pub(crate) fn render(scene: &Scene, size: [u32; 2], file: &Path) -> Result<()> {
    let gpu = Gpu::new()?;
    let mut renderer = Renderer::new(&gpu, scene, &|_| {})?;
    let pose = Pose::of(&scene.cameras[0], |x, y| renderer.ground_m(x, y));
    let request = RenderRequest::new(pose, size).with(|r| r.outputs.displayed = true);
    let picture = renderer.render(&request)?;
    write_png(file, &picture, request.stages.display)
}

#[allow(dead_code, reason = "a test calls the function above")]
fn main() -> Result<()> {
    let file = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("frame.png"), PathBuf::from);
    render(&scene::load(scene::DEFAULT)?, [640, 360], &file)?;
    println!("{}", file.display());
    Ok(())
}
