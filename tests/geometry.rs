//! Tests of stitching, which moves (welds) the vertices on the border to a coarser node to vertices that this neighbour has. Compares the vertex
//! stage on the GPU with its reference, and checks that the reference gives vertices that the neighbour has.

use kernels::geometry::{STITCH_WGSL, reference};
use kernels::probe::table;

use crate::fixtures::gpu;

/// Returns rows of a vertex's index and the deltas of the node. A delta is the number of levels by which the neighbour on one side is coarser; the
/// deltas of the four sides are packed with 4 bits each. The rows have every border vertex and some inner vertices, and every delta from 0 to 5 on
/// every side.
fn rows() -> Vec<([u32; 2], u32)> {
    let mut rows = Vec::new();
    for deltas in (0..6u32).flat_map(|d| [d, d << 4, d << 8, d << 12, d | d << 4 | d << 8 | d << 12, d | (5 - d) << 4]) {
        for i in 0..=128 {
            rows.extend([[i, 0], [i, 128], [0, i], [128, i], [i, 64], [i, 127 - i / 2]].map(|index| (index, deltas)));
        }
    }
    rows
}

fn on_gpu(wgsl: &str) -> Vec<[u32; 2]> {
    // Probes already contain the original text of the stage, so the functions in this copy are renamed.
    let wgsl = wgsl.replace("geometry_", "stitching_");
    let body = format!(
        "{wgsl}\nfn probe(row: array<f32, 3>) -> array<f32, 2> {{
    let kept = stitching_stitch(vec2<u32>(u32(row[0]), u32(row[1])), u32(row[2]));
    return array<f32, 2>(f32(kept.x), f32(kept.y));
}}"
    );
    let inputs: Vec<f32> = rows().iter().flat_map(|(i, d)| [i[0] as f32, i[1] as f32, *d as f32]).collect();
    let out = table::run(gpu(), &body, &inputs, 3, 2).expect("the probe runs");
    out.chunks_exact(2).map(|c| [c[0] as u32, c[1] as u32]).collect()
}

fn differences(wgsl: &str) -> usize {
    on_gpu(wgsl).iter().zip(rows()).filter(|(kept, (index, deltas))| **kept != reference::stitch(*index, *deltas)).count()
}

#[test]
fn stitching_equals_its_reference() {
    assert_eq!(differences(STITCH_WGSL.text), 0);
    // Negative controls: a vertex halfway between two vertices of the neighbour moves to the upper one; the northern border uses the delta of the
    // southern neighbour.
    for (from, to) in [("(step - 1u) / 2u", "step / 2u"), ("(deltas >> 12u) & 15u", "(deltas >> 4u) & 15u")] {
        assert!(STITCH_WGSL.text.contains(from), "the mutant must change something");
        assert!(differences(&STITCH_WGSL.text.replace(from, to)) > 0, "{to} passes");
    }
}

#[test]
fn welded_vertices_are_the_neighbours_and_the_nearest() {
    for delta in 0..=5u32 {
        let step = 1 << delta;
        for index in 0..=128u32 {
            let kept = reference::weld(index, delta);
            assert_eq!(kept % step, 0, "the neighbour has no vertex {kept} at delta {delta}");
            assert!(kept <= 128 && kept.abs_diff(index) <= step / 2, "{index} moves to {kept} at delta {delta}");
        }
        assert_eq!((reference::weld(0, delta), reference::weld(128, delta)), (0, 128), "corners must not move");
    }
}
