//! Runs one WGSL function that needs no bindings over rows of numbers, so that the GPU can be compared with its f64 reference.

use crate::error::Result;
use crate::geometry;
use crate::gpu::{Gpu, Shader, read_buffer};
use crate::shared;

/// Applies `body` to every row. `body` is WGSL that defines
/// `fn probe(row: array<f32, IN>) -> array<f32, OUT>` over the shared functions; inputs and outputs are row-major.
///
/// # Errors
/// When the WGSL does not compile (file and line) or the device is lost.
pub fn run(gpu: &Gpu, body: &str, inputs: &[f32], in_columns: usize, out_columns: usize) -> Result<Vec<f32>> {
    let rows = inputs.len() / in_columns;
    if rows == 0 {
        return Ok(Vec::new());
    }
    let main = format!(
        "@group(0) @binding(0) var<storage, read> probe_in: array<f32>;
@group(0) @binding(1) var<storage, read_write> probe_out: array<f32>;
@compute @workgroup_size(64)
fn probe_main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {{
    let row = id.x + id.y * groups.x * 64u;
    if row >= {rows}u {{ return; }}
    var values: array<f32, {in_columns}>;
    for (var i = 0u; i < {in_columns}u; i++) {{ values[i] = probe_in[row * {in_columns}u + i]; }}
    let results = probe(values);
    for (var i = 0u; i < {out_columns}u; i++) {{ probe_out[row * {out_columns}u + i] = results[i]; }}
}}"
    );
    let mut files: Vec<(&str, &str)> = shared::WGSL.to_vec();
    files.push(geometry::STITCH_WGSL);
    files.push(("probe body", body));
    files.push(("probe main", &main));
    let shader = Shader::new(gpu, "probe", &files)?;
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("probe"),
        layout: None,
        module: &shader.module,
        entry_point: Some("probe_main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let input = gpu.buffer_with("probe in", wgpu::BufferUsages::STORAGE, bytemuck::cast_slice(inputs));
    let out_bytes = (rows * out_columns * 4) as u64;
    let output = gpu.buffer("probe out", wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC, out_bytes);
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("probe"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: input.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: output.as_entire_binding() },
        ],
    });
    let mut encoder = gpu.encoder("probe");
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("probe"), timestamp_writes: None });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        let workgroups = u32::try_from(rows.div_ceil(64)).unwrap_or(u32::MAX);
        let x = workgroups.min(65_535);
        pass.dispatch_workgroups(x, workgroups.div_ceil(x), 1);
    }
    gpu.queue.submit([encoder.finish()]);
    Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &output, out_bytes)?))
}
