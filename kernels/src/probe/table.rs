//! Evaluates a WGSL function for each row of a table, so that the GPU can be compared with the function's f64 reference. The function
//! cannot use bindings.

use crate::base::error::Result;
use crate::base::wgsl::{self, Piece};
use crate::geometry;
use crate::gpu::{Gpu, Shader, read_buffer};
use crate::shared;

/// The types that a table's function takes and returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cells {
    /// `fn probe(row: array<f32, IN>) -> array<f32, OUT>`.
    Reals,
    /// `fn probe(row: array<u32, IN>) -> array<u32, OUT>`: words and the bits of reals.
    Bits,
    /// `fn probe(row: array<u32, IN>, texel: vec4<f32>) -> array<u32, OUT>`: each row begins with a block of a compressed texture. The last
    /// value of the row is the index of a texel in this block: 0 to 15, row by row, as the bits of a real. `texel` is this texel as the device
    /// decodes it.
    Texel(wgpu::TextureFormat),
}

/// Number of blocks in a row of the texture that holds a table's blocks. The texture is then 4096 texels wide, half of the width that WebGPU
/// guarantees.
const BLOCKS_ACROSS: usize = 1024;
/// Largest number of rows in one call. It bounds the size of the buffers and the height of the texture that holds the blocks.
const MOST_ROWS: usize = BLOCKS_ACROSS * BLOCKS_ACROSS;

/// A function that is compiled once and applied to any number of rows.
pub struct Table<'a> {
    gpu: &'a Gpu,
    pipeline: wgpu::ComputePipeline,
    columns: [usize; 2],
    cells: Cells,
}

impl<'a> Table<'a> {
    /// Compiles `body`, which is WGSL that defines the function `probe` and may call the shared functions. `columns` are the numbers of cells in a
    /// row of inputs and of results.
    ///
    /// # Errors
    /// The WGSL does not compile (the message gives file and line), or the device is lost.
    pub fn new(gpu: &'a Gpu, body: &str, columns: [usize; 2], cells: Cells) -> Result<Table<'a>> {
        let main = main(columns, cells);
        let mut pieces = wgsl::pieces(shared::WGSL);
        pieces.extend(wgsl::pieces(&[&geometry::STITCH_WGSL]));
        pieces.extend([Piece::new("probe body", body), Piece::new("probe main", main)]);
        let shader = Shader::new(gpu, "probe", pieces)?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("probe"),
            layout: None,
            module: &shader.module,
            entry_point: Some("probe_main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Table { gpu, pipeline, columns, cells })
    }

    /// Largest number of rows that [`Table::run`] accepts.
    pub fn most_rows(&self) -> usize {
        MOST_ROWS
    }

    /// Applies the function to every row. `inputs` holds whole rows, one after the other, and the result holds the rows of outputs in the same order.
    /// Reals are passed as their bits.
    ///
    /// # Errors
    /// The device is lost.
    ///
    /// # Panics
    /// If there are more rows than [`Table::most_rows`].
    pub fn run(&self, inputs: &[u32]) -> Result<Vec<u32>> {
        let (gpu, [in_columns, out_columns]) = (self.gpu, self.columns);
        let rows = inputs.len() / in_columns;
        if rows == 0 {
            return Ok(Vec::new());
        }
        assert!(rows <= self.most_rows(), "{rows} rows are too many for one call: see Table::most_rows");
        let input = gpu.buffer_with("probe in", wgpu::BufferUsages::STORAGE, bytemuck::cast_slice(inputs));
        let out_bytes = (rows * out_columns * 4) as u64;
        let output = gpu.buffer("probe out", wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC, out_bytes);
        let count =
            gpu.buffer_with("probe rows", wgpu::BufferUsages::UNIFORM, bytemuck::bytes_of(&[u32::try_from(rows).unwrap_or(0), 0, 0, 0]));
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: input.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: output.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 2, resource: count.as_entire_binding() },
        ];
        let blocks = match self.cells {
            Cells::Texel(format) => Some(self.blocks(format, inputs)),
            Cells::Reals | Cells::Bits => None,
        };
        if let Some((view, sampler)) = &blocks {
            entries.push(wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::TextureView(view) });
            entries.push(wgpu::BindGroupEntry { binding: 4, resource: wgpu::BindingResource::Sampler(sampler) });
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("probe"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = gpu.encoder("probe");
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("probe"), timestamp_writes: None });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            let workgroups = u32::try_from(rows.div_ceil(64)).unwrap_or(u32::MAX);
            let x = workgroups.min(65_535);
            pass.dispatch_workgroups(x, workgroups.div_ceil(x), 1);
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &output, out_bytes)?))
    }

    /// Creates a texture from the compressed blocks (4 x 4 texels) with which the input rows begin, and a sampler that reads the nearest texel.
    fn blocks(&self, format: wgpu::TextureFormat, inputs: &[u32]) -> (wgpu::TextureView, wgpu::Sampler) {
        let words = format.block_copy_size(None).unwrap_or(0) as usize / 4;
        let mut bytes: Vec<u8> =
            inputs.chunks_exact(self.columns[0]).flat_map(|row| bytemuck::cast_slice(&row[..words]).to_vec()).collect();
        let down = inputs.len().div_ceil(self.columns[0] * BLOCKS_ACROSS);
        bytes.resize(BLOCKS_ACROSS * down * words * 4, 0);
        let [across, down] = [BLOCKS_ACROSS, down].map(|blocks| u32::try_from(blocks).unwrap_or(0));
        let size = wgpu::Extent3d { width: 4 * across, height: 4 * down, depth_or_array_layers: 1 };
        let texture = self.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("probe blocks"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(across * u32::try_from(words).unwrap_or(0) * 4),
            rows_per_image: Some(down),
        };
        self.gpu.queue.write_texture(texture.as_image_copy(), &bytes, layout, size);
        let sampler = self.gpu.device.create_sampler(&wgpu::SamplerDescriptor { label: Some("probe"), ..Default::default() });
        (texture.create_view(&wgpu::TextureViewDescriptor::default()), sampler)
    }
}

/// The WGSL of the entry point that calls the function. Cells are passed as words, because an f32 may not preserve every bit pattern.
fn main([in_columns, out_columns]: [usize; 2], cells: Cells) -> String {
    let (of_row, from, to) = match cells {
        Cells::Reals => ("f32", "bitcast<f32>", "bitcast<u32>"),
        Cells::Bits | Cells::Texel(_) => ("u32", "", ""),
    };
    let (binding, texel) = if matches!(cells, Cells::Texel(_)) {
        let place = format!(
            "    let texel = u32(bitcast<f32>(values[{in_columns}u - 1u])) & 15u;
    let at = vec2<u32>(row % {BLOCKS_ACROSS}u, row / {BLOCKS_ACROSS}u) * 4u + vec2<u32>(texel & 3u, texel >> 2u);
    let place = (vec2<f32>(at) + 0.5) / vec2<f32>(textureDimensions(probe_blocks));\n"
        );
        let bindings = "@group(0) @binding(3) var probe_blocks: texture_2d<f32>;\n@group(0) @binding(4) var probe_sampler: sampler;\n";
        // The texel is read at its centre with a sampler, because the shaders of the frame also read block textures with a sampler.
        (bindings, (place, ", textureSampleLevel(probe_blocks, probe_sampler, place, 0.0)"))
    } else {
        ("", (String::new(), ""))
    };
    let (place, texel) = texel;
    format!(
        "@group(0) @binding(0) var<storage, read> probe_in: array<u32>;
@group(0) @binding(1) var<storage, read_write> probe_out: array<u32>;
@group(0) @binding(2) var<uniform> probe_rows: vec4<u32>;
{binding}@compute @workgroup_size(64)
fn probe_main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {{
    let row = id.x + id.y * groups.x * 64u;
    if row >= probe_rows.x {{ return; }}
    var values: array<{of_row}, {in_columns}>;
    for (var i = 0u; i < {in_columns}u; i++) {{ values[i] = {from}(probe_in[row * {in_columns}u + i]); }}
{place}    let results = probe(values{texel});
    for (var i = 0u; i < {out_columns}u; i++) {{ probe_out[row * {out_columns}u + i] = {to}(results[i]); }}
}}"
    )
}

/// Compiles `body` and applies it once to rows of reals: see [`Cells::Reals`].
///
/// # Errors
/// The WGSL does not compile (the message gives file and line), or the device is lost.
///
/// # Panics
/// If there are more rows than [`Table::most_rows`].
pub fn run(gpu: &Gpu, body: &str, inputs: &[f32], in_columns: usize, out_columns: usize) -> Result<Vec<f32>> {
    let results = Table::new(gpu, body, [in_columns, out_columns], Cells::Reals)?.run(bytemuck::cast_slice(inputs))?;
    Ok(bytemuck::cast_vec(results))
}
