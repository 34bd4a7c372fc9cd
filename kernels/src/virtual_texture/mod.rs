//! Virtual texture: pages of the blended splat map, seen from above. They are rendered when they are needed, cached, and sampled with 4 fetches.
//!
//! Reads depth, normals and mask to find the visible pages, and renders the pages from the splat map and the detail textures. Writes the page table
//! (R32Uint): 64 x 64 cells for each level. A page uses the cell at its column and row modulo 64. A cell stores the physical layer + 1 (0 = no page)
//! in 11 bits. 20 more bits are a tag, which distinguishes the pages that share the cell. Also writes the physical pages, which are layers of three
//! array textures: albedo (sRGB), smoothness + specular occlusion, and normal. A page has 256 x 256 texels, a border of 4 texels on each side, and a
//! second mip level.
//! Source: Moore, GDC 2018, "Virtual Texturing", "Virtual Texture Page Rendering"; ruling 10 in `ARCHITECTURE.md`.
//!
//! Limits: pages of one level whose columns and rows differ by multiples of 64 share a cell of the page table. The page with the larger tag is kept,
//! so the result does not depend on the order of threads; pixels of the rejected page use a coarser page. If a frame requests more than 256 pages,
//! the finest pages are replaced by their parents, level by level; [`PageCounts::coarsened`] counts the replacements. A pixel whose page is missing
//! tries the coarser levels in turn and finally uses the far atlas. Each try is one counted fetch of the page table, so the virtual texture may cost
//! more than 4 fetches.
//!
//! Rendering of pages is never postponed: within the limits above, the pages that the pixels of a frame request are rendered before the frame is
//! shaded. Not implemented: jittered feedback, which would replace `encode_requests`; page budgets and compression, which would extend `fill`; and
//! Far Cry 4's adaptive address space, which would replace the assignment of pages to cells.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};

use bytemuck::{Pod, Zeroable, cast_slice};
use glam::IVec2;

use crate::base::error::Result;
use crate::base::section::{Section, mebibytes, row};
use crate::base::wgsl::{Constant, Wgsl};
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, array, aspect, view};
use crate::gpu::uses::{PassUse, TextureUse};
use crate::gpu::{Gpu, Recording, ShaderModule, constants, read_buffer, texture_bytes};
use crate::shared;
use crate::stage::{Build, Canvas, Declaration, Exchange, Stage};
use crate::terrain;
use crate::variant::Flavour;
use crate::view;
use crate::world::{Layout, NodeId, SECTORS};

pub mod reference;

/// Texels along a page's edge, without the border.
pub const PAGE_TEXELS: u32 = 256;
/// Border texels on each side.
pub const BORDER_TEXELS: u32 = 4;
/// Texels along a page's edge, with the border.
pub const STORED_TEXELS: u32 = PAGE_TEXELS + 2 * BORDER_TEXELS;
/// Number of levels; the edge of a page is 1 m at the finest level and 8 192 m at the coarsest.
pub const LEVELS: u32 = 14;
/// Texel density of level 0, texels per metre.
pub const TEXELS_PER_M: f64 = 256.0;
/// Number of cells along the edge of a level's page table.
pub const WINDOW: u32 = 64;
/// Largest number of cached pages. This number of pages takes about 180 MB.
pub const CAPACITY: u32 = 256;
const TAG_BITS: u32 = 10;

/// Number of low bits of a page-table cell that store the physical layer + 1. The tag is above these bits: first the bits of the column, then the
/// bits of the row.
const LAYER_BITS: u32 = 11;
const LAYER_MASK: u32 = (1 << LAYER_BITS) - 1;
const TAG_MASK: u32 = (1 << TAG_BITS) - 1;

/// WGSL functions that compute addresses of pages.
pub static WGSL: Wgsl =
    Wgsl::new("virtual_texture/virtual_texture.wgsl", include_str!("virtual_texture.wgsl"), &[&terrain::WGSL, &view::WGSL]).with(&[
        ("VIRTUAL_PAGE_TEXELS", Constant::real(PAGE_TEXELS as f64)),
        ("VIRTUAL_BORDER_TEXELS", Constant::real(BORDER_TEXELS as f64)),
        ("VIRTUAL_STORED_TEXELS", Constant::real(STORED_TEXELS as f64)),
        ("VIRTUAL_WINDOW", Constant::I32(WINDOW as i32)),
        ("VIRTUAL_WINDOW_BITS", Constant::U32(WINDOW.trailing_zeros())),
        ("VIRTUAL_LAYER_BITS", Constant::U32(LAYER_BITS)),
        ("VIRTUAL_LAYER_MASK", Constant::U32(LAYER_MASK)),
        ("VIRTUAL_TAG_BITS", Constant::U32(TAG_BITS)),
        ("VIRTUAL_TAG_MASK", Constant::U32(TAG_MASK)),
    ]);
static PAGE_WGSL: Wgsl =
    Wgsl::new("virtual_texture/page.wgsl", include_str!("page.wgsl"), &[&terrain::WGSL, &view::WGSL, &view::FULL_SCREEN]);
static REQUEST_WGSL: Wgsl = Wgsl::new(
    "virtual_texture/request.wgsl",
    include_str!("request.wgsl"),
    &[&WGSL, &terrain::WGSL, &terrain::FOOTPRINT_WGSL, &view::WGSL, &shared::FLAVOUR_WEIGHTS],
);

/// The module that renders pages.
pub static PAGE_MODULE: ShaderModule = ShaderModule::new("pages", &[&PAGE_WGSL]);
/// The module that requests pages.
pub static REQUEST_MODULE: ShaderModule = ShaderModule::new("page requests", &[&REQUEST_WGSL]);

/// A page: its level, and its column and row, counted from the world's south-west corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PageId {
    /// 0 = finest.
    pub level: u32,
    /// Column.
    pub x: u32,
    /// Row, from the south.
    pub y: u32,
}

impl PageId {
    /// Edge in metres.
    pub fn edge_m(self) -> f64 {
        f64::from(PAGE_TEXELS) / TEXELS_PER_M * f64::from(1u32 << self.level)
    }

    /// Index of the page's cell in the page table.
    fn cell(self) -> usize {
        ((self.level * WINDOW + self.y % WINDOW) * WINDOW + self.x % WINDOW) as usize
    }

    /// Tag of the page, which distinguishes it from other pages with the same cell: bits of its column and row that do not follow from the cell. The
    /// tag is shifted to its place in the cell, above the physical layer.
    fn tag(self) -> u32 {
        let wrap = TAG_MASK;
        ((self.y / WINDOW) & wrap) << (LAYER_BITS + TAG_BITS) | ((self.x / WINDOW) & wrap) << LAYER_BITS
    }

    /// Returns the page of a non-zero request. `index`: index of its cell in the page table. `camera`: column and row of the page of level 0 at the
    /// south-west corner of the camera's sector. Tags repeat every 2^16 pages, so several pages may match the request. The match nearest to `camera`
    /// is returned, because no picture should request fine pages that are 32 km away.
    fn of_request(index: usize, request: u32, camera: [i64; 2]) -> PageId {
        let index = u32::try_from(index).unwrap_or(0);
        let wrap = TAG_MASK;
        let level = index / (WINDOW * WINDOW);
        let unwrap = |low: u32, camera: i64| {
            let period = i64::from(WINDOW) << TAG_BITS;
            let camera = camera >> level;
            let near = camera + (i64::from(low) - camera + period / 2).rem_euclid(period) - period / 2;
            u32::try_from(near).unwrap_or(low)
        };
        PageId {
            level,
            x: unwrap(((request >> LAYER_BITS) & wrap) * WINDOW + index % WINDOW, camera[0]),
            y: unwrap(((request >> (LAYER_BITS + TAG_BITS)) & wrap) * WINDOW + index / WINDOW % WINDOW, camera[1]),
        }
    }

    fn parent(self) -> Option<PageId> {
        (self.level + 1 < LEVELS).then(|| PageId { level: self.level + 1, x: self.x / 2, y: self.y / 2 })
    }
}

/// One mip level of one page to render; the layout matches `PageJob` in `page.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PageJob {
    /// Sector of the page's south-west corner.
    pub sector: [i32; 2],
    /// Position of the page's south-west corner in the sector, metres.
    pub origin: [f32; 2],
    /// Edge of a texel of this mip level, metres.
    pub texel_m: f32,
    /// Texels of border on each side, at this mip level.
    pub border: f32,
}

/// How many pages one frame requested and rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageCounts {
    /// Number of pages that the picture requested.
    pub wanted: usize,
    /// Number of pages that were rendered for this frame, because they were not cached or the nodes under them had changed.
    pub rendered: usize,
    /// Number of times that a page was replaced by its parent, because all requested pages together did not fit in the cache.
    pub coarsened: usize,
    /// Number of pages that the picture requested, by level.
    pub wanted_by_level: [usize; LEVELS as usize],
}

/// Contents of the page cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CacheCounts {
    /// Number of cached pages.
    pub resident: usize,
    /// Largest number of cached pages; 0 = the scene has no virtual texture.
    pub capacity: usize,
    /// Bytes allocated for pages and page table, unused pages included.
    pub bytes: u64,
    /// Number of cached pages, by level.
    pub by_level: [usize; LEVELS as usize],
}

struct Physical {
    layer: u32,
    /// Fingerprint of the nodes from which the page was rendered, see [`source_of`]. If they change, the page must be rendered again.
    source: u64,
    used: u64,
}

/// The passes, which are compiled only for scenes that have a virtual texture.
struct Passes {
    request_pipeline: wgpu::ComputePipeline,
    request_layout: wgpu::BindGroupLayout,
    page_pipeline: wgpu::RenderPipeline,
    job_layout: wgpu::BindGroupLayout,
}

/// The stage.
pub struct VirtualTexture {
    passes: Option<Passes>,
    requests: wgpu::Buffer,
    /// The page table: R32Uint, 64 x 64 cells, one layer per level.
    pub table: wgpu::Texture,
    /// The cached pages, one layer per page: albedo, smoothness + specular occlusion, normal.
    pub pages: [wgpu::Texture; 3],
    /// Sampler of the pages: trilinear, with an anisotropy that the border of a page allows.
    pub sampler: wgpu::Sampler,
    cache: HashMap<PageId, Physical>,
    free: Vec<u32>,
    frame: u64,
    /// Counts of the last frame.
    counts: PageCounts,
}

/// Returns the anisotropy with which pages are filtered: the anisotropy of the scene, but at most 4, because the border of a page has 4 texels.
pub fn anisotropy(scene: u16) -> u16 {
    scene.clamp(1, 4)
}

/// Returns the reason why the passes and textures are, or are not, required. `explain` prints it.
const fn reason(required: bool) -> &'static str {
    if required { "virtual texture" } else { "no virtual texture" }
}

/// Number of mip levels of a page.
const PAGE_MIPS: u32 = 2;
const PAGE_FORMATS: [wgpu::TextureFormat; 3] =
    [wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Rg8Unorm, wgpu::TextureFormat::Rg8Unorm];

impl Passes {
    /// Compiles both passes.
    ///
    /// # Errors
    /// When a shader does not compile.
    fn new(build: Build<'_>) -> Result<Passes> {
        let Build { gpu, frame: frame_layout, terrain, demands, .. } = build;
        let request_layout = gpu.layout(
            "page requests",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::Depth, Binding::TextureLoaded(FLAT), Binding::TextureUint(FLAT), Binding::StorageWritten],
        );
        let request_shader = REQUEST_MODULE.compile(gpu)?;
        let request_pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("page requests"),
            layout: Some(&gpu.pipeline_layout("page requests", &[frame_layout, &terrain.layout, &request_layout])),
            module: &request_shader.module,
            entry_point: Some("virtual_texture_request"),
            compilation_options: Default::default(),
            cache: None,
        });
        let job_layout = gpu.layout("page jobs", wgpu::ShaderStages::FRAGMENT, &[Binding::Storage]);
        let page_shader = PAGE_MODULE.compile(gpu)?;
        let overrides = [("COLOUR_MODULATION", f64::from(u8::from(demands.colour_modulation)))];
        let page_pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("pages"),
            layout: Some(&gpu.pipeline_layout("pages", &[frame_layout, &terrain.layout, &job_layout])),
            vertex: wgpu::VertexState {
                module: &page_shader.module,
                entry_point: Some("page_vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &page_shader.module,
                entry_point: Some("page_fragment"),
                compilation_options: constants(&overrides),
                targets: &PAGE_FORMATS.map(|f| Some(f.into())),
            }),
            multiview_mask: None,
            cache: None,
        });
        Ok(Passes { request_pipeline, request_layout, page_pipeline, job_layout })
    }
}

fn pages_section(wanted: &PageCounts, cache: &CacheCounts) -> Section {
    let mut rows = Vec::new();
    if cache.capacity == 0 {
        rows.push(row("Virtual texture", "none in this scene"));
    } else {
        rows.push(row("Pages wanted", wanted.wanted));
        rows.push(row("Pages rendered for this frame", wanted.rendered));
        rows.push(row("Pages replaced by coarser ones", wanted.coarsened));
        rows.push(row("Pages kept", format!("{} of {}", cache.resident, cache.capacity)));
        for (level, (wanted, kept)) in (0..).zip(wanted.wanted_by_level.iter().zip(&cache.by_level)) {
            if *wanted > 0 || *kept > 0 {
                let edge_m = PageId { level, x: 0, y: 0 }.edge_m();
                rows.push(row(&format!("    level {level}, {edge_m} m"), format!("{wanted} wanted, {kept} kept")));
            }
        }
        rows.push(row("Memory of the pages", mebibytes(cache.bytes)));
    }
    Section { name: "Pages", about: "Virtual texture: pages that pixels request are rendered once, seen from above, and cached", rows }
}

impl Stage for VirtualTexture {
    const DECLARATION: Declaration = Declaration {
        passes: |demands| {
            let required = demands.has(Flavour::VirtualTexture);
            ["page requests", "pages"].map(|name| PassUse { name, pipelines: 1, required, reason: reason(required) }).into()
        },
        textures: |demands| {
            let required = demands.has(Flavour::VirtualTexture);
            let page = |name, format| TextureUse::new(name, format, STORED_TEXELS, PAGE_MIPS, CAPACITY, reason(required));
            let [albedo, properties, normal] = PAGE_FORMATS;
            let all = [
                page("page albedo", albedo),
                page("page normal", normal),
                page("page smoothness, occlusion", properties),
                TextureUse::new("page table", wgpu::TextureFormat::R32Uint, WINDOW, 1, LEVELS, reason(required)),
            ];
            all.map(|texture| texture.unless(required, reason(required))).into()
        },
        name: "virtual texture",
        about: "Reads depth, normals, mask, splat map and detail textures; writes page requests, the missing pages and the page table",
        modules: &[&REQUEST_MODULE, &PAGE_MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = ();

    fn targets(_: Canvas<'_>) {}

    /// Compiles the passes and allocates the physical pages. If the scene has no virtual texture, nothing is compiled, and the textures exist only
    /// because a binding of the shading pass cannot be empty.
    fn build(build: Build<'_>) -> Result<VirtualTexture> {
        let gpu = build.gpu;
        let capacity = if build.demands.has(Flavour::VirtualTexture) { CAPACITY } else { 0 };
        let anisotropic = build.demands.anisotropy;
        let passes = if capacity > 0 { Some(Passes::new(build)?) } else { None };
        let capacity = capacity.clamp(1, gpu.device.limits().max_texture_array_layers.min(2046));
        let texture = |label, size, layers, mips, format, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: layers },
                mip_level_count: mips,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            })
        };
        let table = texture("page table", WINDOW, LEVELS, 1, wgpu::TextureFormat::R32Uint, wgpu::TextureUsages::COPY_DST);
        let pages = PAGE_FORMATS.map(|f| texture("pages", STORED_TEXELS, capacity, PAGE_MIPS, f, wgpu::TextureUsages::RENDER_ATTACHMENT));
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("pages"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: anisotropy(anisotropic),
            ..Default::default()
        });
        Ok(VirtualTexture {
            passes,
            requests: gpu.buffer(
                "page requests",
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
                u64::from(LEVELS * WINDOW * WINDOW) * 4,
            ),
            table,
            pages,
            sampler,
            cache: HashMap::new(),
            free: (0..capacity).rev().collect(),
            frame: 0,
            counts: PageCounts::default(),
        })
    }

    fn modules(build: Build<'_>) -> Vec<&'static ShaderModule> {
        if build.demands.has(Flavour::VirtualTexture) { Self::DECLARATION.modules.to_vec() } else { Vec::new() }
    }

    /// Rebuilds the passes. The cache stays allocated, but it is emptied, so pages are rendered again when they are needed.
    fn rebuilt(&self, build: Build<'_>) -> Result<Exchange<VirtualTexture>> {
        let passes = Some(Passes::new(build)?);
        Ok(Box::new(move |stage| {
            stage.passes = passes;
            stage.forget();
        }))
    }

    fn section(&self) -> Option<Section> {
        Some(pages_section(&self.counts, &self.cache_counts()))
    }
}

impl VirtualTexture {
    /// Empties the cache. Call this after any input of page rendering has changed.
    pub fn forget(&mut self) {
        self.free.extend(self.cache.drain().map(|(_, physical)| physical.layer));
        // Restores the initial order: layers are taken from the end, the lowest first.
        self.free.sort_unstable_by_key(|&layer| std::cmp::Reverse(layer));
    }

    /// Begins a frame that samples no pages: resets the counts and returns them.
    pub fn rest(&mut self) -> PageCounts {
        // The frame number is increased, so that pages that the previous frame used do not count as used by this frame.
        self.frame += 1;
        self.counts = PageCounts::default();
        self.counts
    }

    /// Whether the scene has a virtual texture.
    pub fn is_required(&self) -> bool {
        self.passes.is_some()
    }

    /// Returns the page that the last frame used in place of `page`: `page` itself or, if the frame did not use it, the finest of its ancestors that
    /// the frame used. `None` = the frame used none of them.
    pub fn serving(&self, page: PageId) -> Option<PageId> {
        let serves = |page: &PageId| self.cache.get(page).is_some_and(|physical| physical.used == self.frame);
        std::iter::successors(Some(page), |page| page.parent()).find(serves)
    }

    /// Current contents of the cache.
    pub fn cache_counts(&self) -> CacheCounts {
        let mut by_level = [0; LEVELS as usize];
        for page in self.cache.keys() {
            by_level[page.level as usize] += 1;
        }
        CacheCounts {
            resident: self.cache.len(),
            capacity: if self.is_required() { self.pages[0].depth_or_array_layers() as usize } else { 0 },
            bytes: self.pages.iter().chain([&self.table]).map(texture_bytes).sum(),
            by_level,
        }
    }

    /// Records the pass that marks the pages that the pixels of this frame would sample.
    pub fn encode_requests(&self, rec: &mut Recording<'_>, targets: &geometry::Targets) {
        let Some(passes) = &self.passes else { return };
        rec.encoder.clear_buffer(&self.requests, 0, None);
        let group = rec.gpu.group(
            "page requests",
            &passes.request_layout,
            &[
                wgpu::BindingResource::TextureView(&aspect(&targets.depth_stencil, wgpu::TextureAspect::DepthOnly)),
                wgpu::BindingResource::TextureView(&view(&targets.normals)),
                wgpu::BindingResource::TextureView(&view(&targets.mask)),
                self.requests.as_entire_binding(),
            ],
        );
        let [x, y] = [targets.mask.width(), targets.mask.height()].map(|side| side.div_ceil(8));
        rec.compute("page requests", &passes.request_pipeline, 2, &[&group]).dispatch_workgroups(x, y, 1);
    }

    /// Reads the requests back, renders the missing pages, and writes the page table for this frame. The pass of [`VirtualTexture::encode_requests`]
    /// must have run. `groups`: the bind groups of the frame and of the terrain data. `nodes`: the nodes that the frame may read, each with the
    /// revision of its materials. `camera_sector`: the sector of the camera, which decides which page is rendered if several pages match a request.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn fill(
        &mut self,
        gpu: &Gpu,
        groups: [&wgpu::BindGroup; 2],
        layout: &Layout,
        nodes: &[(NodeId, u64)],
        camera_sector: IVec2,
    ) -> Result<PageCounts> {
        self.frame += 1;
        let pages_per_sector = (layout.sector_m * TEXELS_PER_M / f64::from(PAGE_TEXELS)).round() as i64;
        let camera = camera_sector.to_array().map(|s| i64::from(s) * pages_per_sector);
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.requests, self.requests.size())?);
        let mut wanted: Vec<PageId> =
            words.iter().enumerate().filter(|(_, w)| **w != 0).map(|(i, &w)| PageId::of_request(i, w, camera)).collect();
        let mut counts = PageCounts { wanted: wanted.len(), ..PageCounts::default() };
        for page in &wanted {
            counts.wanted_by_level[page.level as usize] += 1;
        }
        let capacity = self.pages[0].depth_or_array_layers() as usize;
        // If there are too many pages for the cache, the finest pages are replaced by their parents, level by level.
        while wanted.len() > capacity {
            let finest = wanted.iter().map(|p| p.level).min().unwrap_or(0);
            counts.coarsened += wanted.iter().filter(|p| p.level == finest).count();
            wanted = wanted.iter().filter_map(|p| if p.level == finest { p.parent() } else { Some(*p) }).collect();
            wanted.sort_unstable();
            wanted.dedup();
        }
        // The pages are sorted, coarse pages first, so that layers are assigned in a fixed order.
        wanted.sort_unstable_by_key(|p| (std::cmp::Reverse(p.level), p.y, p.x));
        let finest = finest_nodes(nodes);
        for page in &wanted {
            let source = source_of(*page, layout, &finest);
            match self.cache.get_mut(page) {
                Some(physical) if physical.source == source => physical.used = self.frame,
                Some(physical) => physical.used = 0,
                None => {}
            }
        }
        let mut jobs = Vec::new();
        for &page in &wanted {
            if self.cache.get(&page).is_some_and(|p| p.used == self.frame) {
                continue;
            }
            let layer = self.take_layer(page);
            self.cache.insert(page, Physical { layer, source: source_of(page, layout, &finest), used: self.frame });
            jobs.push((page, layer));
        }
        counts.rendered = jobs.len();
        self.render_pages(gpu, groups, layout, &jobs)?;
        self.write_table(gpu);
        self.counts = counts;
        Ok(counts)
    }

    fn take_layer(&mut self, page: PageId) -> u32 {
        if let Some(old) = self.cache.remove(&page) {
            return old.layer;
        }
        if let Some(layer) = self.free.pop() {
            return layer;
        }
        let oldest = self.cache.iter().filter(|(_, p)| p.used < self.frame).min_by_key(|(id, p)| (p.used, **id)).map(|(id, _)| *id);
        let oldest = oldest.expect("a frame requests at most as many pages as there are layers");
        self.cache.remove(&oldest).map_or(0, |p| p.layer)
    }

    fn write_table(&self, gpu: &Gpu) {
        let mut table = vec![0u32; (LEVELS * WINDOW * WINDOW) as usize];
        for (page, physical) in self.cache.iter().filter(|(_, p)| p.used == self.frame) {
            let entry = page.tag() | (physical.layer + 1);
            // If two pages share a cell, the page with the larger tag is kept, as in the request pass.
            table[page.cell()] = table[page.cell()].max(entry);
        }
        gpu.queue.write_texture(
            self.table.as_image_copy(),
            cast_slice(&table),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(WINDOW * 4), rows_per_image: Some(WINDOW) },
            self.table.size(),
        );
    }

    #[allow(clippy::cast_possible_truncation, reason = "sector indices are small, metres are rounded to f32 on purpose")]
    fn render_pages(&self, gpu: &Gpu, groups: [&wgpu::BindGroup; 2], layout: &Layout, pages: &[(PageId, u32)]) -> Result<()> {
        let Some(passes) = self.passes.as_ref().filter(|_| !pages.is_empty()) else { return Ok(()) };
        let mut jobs = Vec::new();
        for (page, _) in pages {
            let edge = page.edge_m();
            let corner = [f64::from(page.x) * edge, f64::from(page.y) * edge];
            let sector = corner.map(|c| (c / layout.sector_m).floor());
            for mip in 0..2u32 {
                let texels = f64::from(PAGE_TEXELS >> mip);
                jobs.push(PageJob {
                    sector: sector.map(|s| s as i32),
                    origin: [(corner[0] - sector[0] * layout.sector_m) as f32, (corner[1] - sector[1] * layout.sector_m) as f32],
                    texel_m: (edge / texels) as f32,
                    border: (BORDER_TEXELS >> mip) as f32,
                });
            }
        }
        let list = gpu.buffer_with("page jobs", wgpu::BufferUsages::STORAGE, cast_slice(&jobs));
        let group = gpu.group("page jobs", &passes.job_layout, &[list.as_entire_binding()]);
        let mut encoder = gpu.encoder("pages");
        for (index, (_, layer)) in (0u32..).zip(pages) {
            for mip in 0..2 {
                let views = self.pages.each_ref().map(|t| {
                    t.create_view(&wgpu::TextureViewDescriptor {
                        dimension: Some(wgpu::TextureViewDimension::D2),
                        base_mip_level: mip,
                        mip_level_count: Some(1),
                        base_array_layer: *layer,
                        array_layer_count: Some(1),
                        ..Default::default()
                    })
                });
                let attachments = views.each_ref().map(|view| {
                    Some(wgpu::RenderPassColorAttachment {
                        view,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store },
                    })
                });
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("page"),
                    color_attachments: &attachments,
                    ..Default::default()
                });
                pass.set_pipeline(&passes.page_pipeline);
                pass.set_bind_group(0, groups[0], &[]);
                pass.set_bind_group(1, groups[1], &[]);
                pass.set_bind_group(2, &group, &[]);
                let job = index * 2 + mip;
                pass.draw(0..3, job..job + 1);
            }
        }
        gpu.submit_and_wait(encoder)
    }

    /// Views that the shading pass binds: table, albedo, properties, normal.
    pub fn views(&self) -> [wgpu::TextureView; 4] {
        [array(&self.table), array(&self.pages[0]), array(&self.pages[1]), array(&self.pages[2])]
    }
}

/// Returns the LOD and the revision of the finest loaded node of each sector, row by row. Pages are rendered from these nodes.
fn finest_nodes(nodes: &[(NodeId, u64)]) -> Vec<(u8, u64)> {
    // Coarse nodes come before fine nodes, so that the finest node of a sector is written last.
    let mut sorted = nodes.to_vec();
    sorted.sort_unstable_by_key(|(n, _)| (std::cmp::Reverse(n.lod), n.y, n.x));
    let side = usize::from(SECTORS);
    // `u8::MAX` = no node is loaded in the sector.
    let mut map = vec![(u8::MAX, 0); side * side];
    for (node, revision) in sorted {
        let edge = 1usize << node.lod;
        let (x, y) = (usize::from(node.x) * edge, usize::from(node.y) * edge);
        for row in y..y + edge {
            map[row * side + x..][..edge].fill((node.lod, revision));
        }
    }
    map
}

/// Returns a fingerprint of the nodes under a page and its border.
fn source_of(page: PageId, layout: &Layout, finest: &[(u8, u64)]) -> u64 {
    let edge = page.edge_m();
    let border = edge / f64::from(PAGE_TEXELS) * f64::from(BORDER_TEXELS);
    let side = i32::from(SECTORS);
    let range = |low: f64| {
        let first = ((low - border) / layout.sector_m).floor().clamp(0.0, f64::from(side - 1));
        let last = ((low + edge + border) / layout.sector_m).floor().clamp(0.0, f64::from(side - 1));
        (first as usize, last as usize)
    };
    let (x, y) = (range(f64::from(page.x) * edge), range(f64::from(page.y) * edge));
    let mut hasher = DefaultHasher::new();
    for row in y.0..=y.1 {
        finest[row * usize::from(SECTORS)..][x.0..=x.1].hash(&mut hasher);
    }
    IVec2::new(i32::try_from(page.x).unwrap_or(0), i32::try_from(page.y).unwrap_or(0)).hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_reported_by_level_and_levels_without_any_are_left_out() {
        let value = |wanted: &PageCounts, cache: &CacheCounts, name: &str| {
            let rows = pages_section(wanted, cache).rows;
            rows.into_iter().find(|(n, _)| n.trim() == name).map(|(_, value)| value)
        };
        let none = (PageCounts::default(), CacheCounts::default());
        assert_eq!(value(&none.0, &none.1, "Virtual texture").as_deref(), Some("none in this scene"));
        let mut wanted = PageCounts { wanted: 5, rendered: 2, ..PageCounts::default() };
        wanted.wanted_by_level[3] = 5;
        let mut cache = CacheCounts { resident: 9, capacity: 256, bytes: 1 << 20, ..CacheCounts::default() };
        (cache.by_level[3], cache.by_level[4]) = (7, 2);
        for (name, expected) in [
            ("Pages kept", Some("9 of 256")),
            ("level 3, 8 m", Some("5 wanted, 7 kept")),
            ("level 4, 16 m", Some("0 wanted, 2 kept")),
            ("level 5, 32 m", None),
            ("Memory of the pages", Some("1.0 MiB")),
            ("Virtual texture", None),
        ] {
            assert_eq!(value(&wanted, &cache, name).as_deref(), expected, "{name}");
        }
    }

    #[test]
    fn a_page_survives_the_way_through_its_request() {
        for page in [
            PageId { level: 0, x: 0, y: 0 },
            PageId { level: 0, x: 70_000, y: 131_071 },
            PageId { level: 3, x: 777, y: 4095 },
            PageId { level: 13, x: 1, y: 2 },
        ] {
            let camera = [i64::from(page.x << page.level) + 900, i64::from(page.y << page.level) - 900];
            assert_eq!(PageId::of_request(page.cell(), page.tag() | 1, camera), page);
        }
        // Negative control: a page `WINDOW` columns away has the same cell but a different tag.
        let (a, b) = (PageId { level: 2, x: 10, y: 5 }, PageId { level: 2, x: 10 + WINDOW, y: 5 });
        assert_eq!(a.cell(), b.cell());
        assert_ne!(a.tag(), b.tag());
    }
}
