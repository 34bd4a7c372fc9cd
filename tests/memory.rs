//! Checks that memory does not grow with the number of frames, because a small leak per frame adds up in a long run. The test is a binary of its own,
//! because it measures the memory of its process.

use std::fs;

use kernels::composition::Layers;
use kernels::frame::{RenderRequest, Renderer};
use kernels::gpu::Gpu;
use kernels::metrics::{Meter, Track, Viewing};
use kernels::scene;
use kernels::shared::signal::{self, Signal};
use kernels::temporal::Resolve;
use kernels::variant::Variant;
use kernels::view::camera::Pose;

const SIZE: [u32; 2] = [64, 48];
/// Number of frames before the first measurement. By then, everything that is allocated only once exists, such as ring buffers, memory pools of the
/// driver, and compiled shaders.
const FIRST: u32 = 30;
/// Number of frames between the two measurements.
const MORE: u32 = 60;
/// Limit of the growth of memory over [`MORE`] frames, KiB. Fragmentation in the allocator may cause a growth of this size. The leak for which this
/// test was written caused a growth of 40 MB.
const SLACK_KIB: u64 = 3 << 10;

/// Returns the resident memory of this process, KiB; `None` if the system does not report it.
fn resident_kib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok()
}

#[test]
fn measured_frames_leave_nothing_behind() {
    if resident_kib().is_none() {
        eprintln!("left out: this system has no /proc/self/status");
        return;
    }
    let gpu = Gpu::new().expect("an adapter");
    let mut scene = scene::load(scene::DEFAULT).expect("the built-in scene");
    scene.detail_size = 64;
    let mut renderer = Renderer::new(&gpu, &scene, &|_| {}).expect("the small scene renders");
    let pose = Pose::of(&scene.cameras[1], |x, y| renderer.ground_m(x, y));
    let layers = Layers::new(&gpu, SIZE);
    let flavours = Variant::new(12).expect("both cliffs");
    let tracks: Vec<Track> = Resolve::ALL.into_iter().flat_map(|resolve| Signal::ALL.map(|signal| Track { signal, resolve })).collect();
    let mut meter: Meter = renderer.meter(SIZE, &tracks, Some(Viewing::default())).expect("a meter");
    let reference = vec![signal::pack([0.5; 3], 1, 0); (SIZE[0] * SIZE[1]) as usize];
    let mut frames = |from: u32, to: u32| {
        for frame in from..to {
            let request = RenderRequest::new(pose, SIZE).with(|r| {
                r.shading.frame = frame;
                r.shading.seed = frame;
            });
            renderer.draw(&request).expect("a frame");
            let frame = renderer.draw_flavours(&request, flavours, &layers).expect("flavours");
            for signal in Signal::ALL {
                meter.write_reference(&gpu, signal, &reference);
            }
            frame.measure(&layers, &mut meter, &vec![Some(flavours); tracks.len()]).expect("sums");
        }
        resident_kib().expect("read above")
    };
    let before = frames(0, FIRST);
    let after = frames(FIRST, FIRST + MORE);
    assert!(after <= before + SLACK_KIB, "{MORE} frames increased memory by {} KiB, from {before} KiB to {after} KiB", after - before);
}
