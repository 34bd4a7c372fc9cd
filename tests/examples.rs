//! Tests that the examples of `kernels` work, and that `render_png.rs` has fewer than 40 lines.

use crate::fixtures::{Folder, small_scene};

#[path = "../kernels/examples/probe_table.rs"]
mod probe_table;
#[path = "../kernels/examples/render_png.rs"]
mod render_png;

#[test]
fn a_frame_is_drawn_to_png_in_under_forty_lines() {
    let folder = Folder::new("example");
    let file = folder.0.join("frame.png");
    render_png::render(&small_scene(), [64, 48], &file).expect("draws");
    let picture = image::open(&file).expect("a PNG").to_rgb8();
    assert_eq!(picture.dimensions(), (64, 48));
    let first = picture.get_pixel(0, 0);
    assert!(picture.pixels().any(|pixel| pixel != first), "the picture has only one colour");
    assert!(include_str!("../kernels/examples/render_png.rs").lines().count() < 40);
}

#[test]
fn a_shared_function_runs_over_a_table() {
    let (name, error) = probe_table::largest_error().expect("runs");
    // The results are components of unit vectors, and codes of up to 254. In f32, their errors are a few ulp of these numbers.
    assert!(name == "octahedral" && error < 1e-4, "{name}: {error}");
}
