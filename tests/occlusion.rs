//! Compares the shaders of the stage `occlusion` with its reference: the depth pyramid, and the list of the patches that are not hidden.

use bytemuck::{Zeroable, bytes_of, cast_slice, pod_collect_to_vec};
use glam::DVec3;
use kernels::geometry::DEPTH_FORMAT;
use kernels::gpu::bindings::{Binding, aspect, view};
use kernels::gpu::{Shader, ShaderModule, read_buffer};
use kernels::occlusion::reference::Levels;
use kernels::occlusion::{CULL_MODULE, OcclusionBatch, REDUCE_MODULE};
use kernels::shared::culling::{cover, level_size};
use kernels::shared::hash;
use kernels::view::FrameUniforms;
use kernels::view::camera::{NEAR_M, Pose, View};

use crate::fixtures::gpu;

/// Pseudo-random number in 0..1. `table` selects a set of numbers.
fn random(index: usize, table: u32, what: u32) -> f64 {
    f64::from(hash::pcg4d([index as u32, table, what, 78])[0]) / 4_294_967_296.0
}

/// Writes a storage buffer of depths into a depth target.
const WRITE_DEPTH: &str = "
@group(0) @binding(0) var<storage, read> depths: array<f32>;
@group(0) @binding(1) var<storage, read> width: u32;
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn depth(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
    return depths[u32(at.y) * width + u32(at.x)];
}";

/// A depth target with these depths.
fn depth_target(depths: &[f32], size: [u32; 2]) -> wgpu::Texture {
    let gpu = gpu();
    let texture = gpu.target("given depth", size, DEPTH_FORMAT);
    let pieces = vec![kernels::base::wgsl::Piece::new("write depth", WRITE_DEPTH)];
    let shader = Shader::new(gpu, "write depth", pieces).unwrap_or_else(|e| panic!("{e}"));
    let layout = gpu.layout("depths", wgpu::ShaderStages::FRAGMENT, &[Binding::Storage, Binding::Storage]);
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("write depth"),
        layout: Some(&gpu.pipeline_layout("write depth", &[&layout])),
        vertex: wgpu::VertexState {
            module: &shader.module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader.module,
            entry_point: Some("depth"),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let buffers = [gpu.buffer_with("depths", storage, cast_slice(depths)), gpu.buffer_with("width", storage, bytes_of(&size[0]))];
    let group = gpu.group("depths", &layout, &[0, 1].map(|i: usize| buffers[i].as_entire_binding()));
    let target = view(&texture);
    let mut encoder = gpu.encoder("given depth");
    {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("given depth"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &target,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0), store: wgpu::StoreOp::Store }),
            }),
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
    gpu.submit_and_wait(encoder).unwrap_or_else(|e| panic!("{e}"));
    texture
}

/// A compute pipeline of a module. Its first bind group holds the frame's uniforms, its second one the given resources.
struct Pass {
    pipeline: wgpu::ComputePipeline,
    frame: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
}

fn pass(module: &ShaderModule, entry_point: &str, uniforms: &FrameUniforms, bindings: &[Binding]) -> Pass {
    let gpu = gpu();
    let of_frame = gpu.layout("frame", wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
    let layout = gpu.layout("given", wgpu::ShaderStages::COMPUTE, bindings);
    let shader = module.compile(gpu).unwrap_or_else(|e| panic!("{e}"));
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&gpu.pipeline_layout(entry_point, &[&of_frame, &layout])),
        module: &shader.module,
        entry_point: Some(entry_point),
        compilation_options: Default::default(),
        cache: None,
    });
    let buffer = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(uniforms));
    let frame = gpu.group("frame", &of_frame, &[buffer.as_entire_binding()]);
    Pass { pipeline, frame, layout }
}

/// Runs a pass with these resources.
fn dispatch(Pass { pipeline, frame, layout }: &Pass, resources: &[wgpu::BindingResource<'_>], groups: [u32; 2]) {
    let gpu = gpu();
    let group = gpu.group("given", layout, resources);
    let mut encoder = gpu.encoder("given");
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups(groups[0], groups[1], 1);
    }
    gpu.submit_and_wait(encoder).unwrap_or_else(|e| panic!("{e}"));
}

/// The first `count` numbers of a buffer. Buffers may be larger than their contents.
fn read<T: bytemuck::Pod>(buffer: &wgpu::Buffer, count: usize) -> Vec<T> {
    let bytes = (count * size_of::<T>()) as u64;
    pod_collect_to_vec(&read_buffer(gpu(), buffer, bytes).unwrap_or_else(|e| panic!("{e}")))
}

/// A value that no pass writes.
const UNTOUCHED: f32 = -7.0;
/// Number of texels after the pyramid that must stay as they are.
const ROOM: usize = 300;

#[test]
fn the_depth_pyramid_equals_its_reference() {
    for (table, size) in (0..).zip([[1, 1], [7, 5], [93, 61], [64, 128], [257, 3], [200, 131]]) {
        let depths: Vec<f32> = (0..(size[0] * size[1]) as usize)
            .map(|i| match random(i, table, 0) {
                u if u < 0.02 => 0.0,
                u if u > 0.9 => 1.0,
                _ => random(i, table, 1) as f32,
            })
            .collect();
        let target = depth_target(&depths, size);
        let depth = aspect(&target, wgpu::TextureAspect::DepthOnly);
        let mut uniforms = FrameUniforms::zeroed();
        uniforms.size = size;
        let bindings = [Binding::Depth, Binding::Storage, Binding::StorageWritten];
        let made = pass(&REDUCE_MODULE, "occlusion_reduce", &uniforms, &bindings);
        // Six levels in two dispatches. After them, the buffer has room that must stay as it is.
        let expected = Levels::of(&depths, size, 6).concat();
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let texels = gpu().buffer_with("pyramid", storage, cast_slice(&vec![UNTOUCHED; expected.len() + ROOM]));
        for from in [0, 3] {
            let from_level = gpu().buffer_with("level", wgpu::BufferUsages::STORAGE, bytes_of::<u32>(&from));
            let resources = [wgpu::BindingResource::TextureView(&depth), from_level.as_entire_binding(), texels.as_entire_binding()];
            dispatch(&made, &resources, level_size(size, from + 3).map(|n| n.div_ceil(8)));
        }
        let found: Vec<f32> = read(&texels, expected.len() + ROOM);
        let wrong = found.iter().zip(&expected).filter(|(found, expected)| found != expected).count();
        assert_eq!(wrong, 0, "{size:?}: {wrong} of {} texels differ", expected.len());
        assert!(
            found[expected.len()..].iter().all(|texel| texel.to_bits() == UNTOUCHED.to_bits()),
            "{size:?}: texels beyond the pyramid were written"
        );
    }
}

/// The layout of `OcclusionBox`.
type Corners = [[f32; 4]; 2];

/// A camera, what it has drawn, and the boxes to test.
struct Given {
    view: View,
    levels: Levels,
    boxes: Vec<Corners>,
}

impl Given {
    const SIZE: [u32; 2] = [200, 131];

    /// A picture of walls at different distances, with some gaps, and boxes in front of and behind them.
    fn random(table: u32) -> Given {
        let pose = Pose { position: DVec3::new(30.0, 40.0, 50.0), yaw: 0.8, pitch: -0.2, fov: 1.1 };
        let view = View::new(pose, Given::SIZE, [0.0; 2], 64.0, 10_240.0);
        let [width, height] = Given::SIZE.map(|n| n as usize);
        let depths: Vec<f32> = (0..width * height)
            .map(|i| {
                let wall = i % width / 25 + 8 * (i / width / 22);
                let distance = 20.0 + 200.0 * random(wall, table, 0);
                if random(i, table, 1) < 0.0005 { 0.0 } else { (NEAR_M / distance) as f32 }
            })
            .collect();
        let boxes = (0..1700).map(|i| {
            let [x, y] = [(2, 200.0), (3, 131.0)].map(|(what, side)| random(i, table, what) * side);
            let distance = 5.0 + 400.0 * random(i, table, 4).powi(2);
            let centre = view.camera + view.ray(x, y) * distance;
            let half =
                DVec3::new(random(i, table, 5), random(i, table, 6), random(i, table, 7)) * (0.02 + 0.15 * random(i, table, 8)) * distance;
            let corners = match i % 60 {
                // An infinite box, as of a patch whose vertices stitching may move out of the patch, and a box around the camera.
                0 => [DVec3::NEG_INFINITY, DVec3::INFINITY],
                1 => [view.camera - half, view.camera + half],
                _ => [centre - half, centre + half],
            };
            corners.map(|corner| [corner.x as f32, corner.y as f32, corner.z as f32, 0.0])
        });
        let boxes = boxes.collect();
        Given { view, levels: Levels::of(&depths, Given::SIZE, 9), boxes }
    }

    /// Whether each box is shown. `None` = rounding may decide. This is assumed if the answer changes when all sides of the box are moved in or out
    /// by 1/20 000 of its distance from the camera.
    fn shown(&self) -> Vec<Option<bool>> {
        let m = self.view.clip_from_local;
        let rows = [m.row(0), m.row(1), m.row(3)].map(|row| row.to_array());
        let is_hidden = |corners: &Corners, grown: f64| {
            let [low, high] = corners.map(|corner| DVec3::new(f64::from(corner[0]), f64::from(corner[1]), f64::from(corner[2])));
            let grown = DVec3::splat(grown * low.midpoint(high).distance(self.view.camera) / 20_000.0);
            let [low, high] = if low.is_finite() { [low - grown, high + grown] } else { [low, high] };
            let size = Given::SIZE.map(f64::from);
            self.levels.hides(cover(rows, NEAR_M, low.to_array(), high.to_array(), size))
        };
        let decided = |corners: &Corners| {
            let [a, b, c] = [-1.0, 0.0, 1.0].map(|grown| is_hidden(corners, grown));
            (a == b && b == c).then_some(!b)
        };
        self.boxes.iter().map(decided).collect()
    }
}

#[test]
fn patches_are_listed_in_order_unless_they_are_hidden() {
    for table in 0..4 {
        let given = Given::random(table);
        let mut uniforms = FrameUniforms::zeroed();
        uniforms.size = Given::SIZE;
        uniforms.near_m = NEAR_M as f32;
        uniforms.clip_from_local = given.view.clip_from_local_f32().to_cols_array_2d();
        // Numbers of patches per batch, from none to many. The lists of the batches have gaps between them, which the pass must not change. The pass
        // writes the second of the five words (draw arguments) of each batch.
        let counts = [1, 255, 256, 0, 257, 900];
        let mut batches = Vec::new();
        let (mut first, mut order) = (7, 3);
        for (index, count) in (0..).zip(counts) {
            batches.push(OcclusionBatch { first, count, order, instances: 5 * index + 1 });
            (first, order) = (first + count, order + count + 11);
        }
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let with = |label, bytes: &[u8]| gpu().buffer_with(label, storage, bytes);
        let untouched = u32::MAX;
        let buffers = [
            with("batches", cast_slice(&batches)),
            with("boxes", cast_slice(&given.boxes)),
            with("pyramid", cast_slice(&given.levels.concat())),
            // All boxes are marked as shown beforehand, so that the test notices if the pass lists boxes that it has not tested.
            with("shown", cast_slice(&vec![1u32; given.boxes.len()])),
            with("order", cast_slice(&vec![untouched; order as usize])),
            with("arguments", cast_slice(&vec![untouched; 5 * counts.len()])),
        ];
        let (read_only, written) = (Binding::Storage, Binding::StorageWritten);
        let made = pass(&CULL_MODULE, "occlusion_cull", &uniforms, &[read_only, read_only, read_only, written, written, written]);
        dispatch(&made, &[0, 1, 2, 3, 4, 5].map(|i: usize| buffers[i].as_entire_binding()), [counts.len() as u32, 1]);
        let lengths_of = [(3, given.boxes.len()), (4, order as usize), (5, 5 * counts.len())];
        let [shown, listed, arguments]: [Vec<u32>; 3] = lengths_of.map(|(i, count): (usize, usize)| read(&buffers[i], count));
        // What is shown equals the reference, except where rounding decides.
        let expected = given.shown();
        let (mut hidden, mut unclear) = (0, 0);
        for (index, (&found, expected)) in shown.iter().zip(&expected).enumerate() {
            if !(7..first as usize).contains(&index) {
                assert_eq!(found, 1, "box {index} is in no batch");
                continue;
            }
            match expected {
                Some(expected) => assert_eq!(found, u32::from(*expected), "table {table}, box {index}: {:?}", given.boxes[index]),
                None => unclear += 1,
            }
            hidden += usize::from(found == 0);
        }
        assert!(hidden > 300 && hidden < 1300 && unclear < 60, "{hidden} hidden, {unclear} unclear");
        // The lists hold the indices of the shown boxes in their order, and the numbers of instances are the lengths of the lists.
        let mut lists = vec![untouched; order as usize];
        let mut lengths = vec![untouched; 5 * counts.len()];
        for batch in &batches {
            let of_batch: Vec<u32> = (batch.first..batch.first + batch.count).filter(|&i| shown[i as usize] == 1).collect();
            lists[batch.order as usize..][..of_batch.len()].copy_from_slice(&of_batch);
            lengths[batch.instances as usize] = of_batch.len() as u32;
        }
        let wrong = listed.iter().zip(&lists).position(|(listed, expected)| listed != expected);
        assert!(wrong.is_none(), "table {table}: entry {wrong:?} of the lists differs");
        assert_eq!(arguments, lengths, "table {table}");
    }
}
