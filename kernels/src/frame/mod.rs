//! The frame, on one page: [`Renderer::render`] calls the stages in their order, what one makes being the next one's argument.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::bytes_of;
use glam::DVec3;

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::classification::{self, Classification, Lists};
use crate::composition::{Composition, Destination, Layers};
use crate::culling::{self, Patch};
use crate::frame::picture::{AovSet, Picture};
use crate::frame::requirements::Requirements;
use crate::geometry::{self, Geometry, NormalEncoding};
use crate::gpu::bindings::Binding;
use crate::gpu::{Gpu, PassTime, Sources, Timer};
use crate::inspect::Inspect;
use crate::lighting::{self, Lighting};
use crate::materials::Palette;
use crate::metrics::{FrameSums, Meter};
use crate::motion::Links;
use crate::quadtree;
use crate::residency::{AtlasCounts, Streaming};
use crate::scene;
use crate::scene::Scene;
use crate::shading::{self, Estimator, Kernel, PipelineKey, Shading};
use crate::shared::flavour_weights::FlavourParams;
use crate::shared::noise::{self, NoiseKind};
use crate::temporal::{Resolve, SamplePattern};
use crate::terrain::{Terrain, palette_means};
use crate::variant::{Flavour, Variant};
use crate::view::FrameUniforms;
use crate::view::camera::{NEAR_M, Pose, View};
use crate::virtual_texture::{self, CacheCounts, PageCounts, VirtualTexture};
use crate::world::{NodeId, PaletteMeans, World};

mod edit;
pub mod export;
pub mod picture;
mod reload;
pub mod requirements;

pub use edit::EditCounts;
pub use reload::{ReloadReport, shader_files};

/// Which shader shades which tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum VariantChoice {
    /// Each tile by the variant its pixels need.
    Auto,
    /// Every tile by this variant; each of its flavours is evaluated on every pixel.
    Forced(Variant),
    /// The generic kernel on every tile, with the mask that `Auto` would give it.
    GenericAuto,
    /// The generic kernel on every tile, with this mask.
    GenericForced(Variant),
}

impl VariantChoice {
    /// Whether some pixel may be shaded by this flavour.
    pub fn may_use(self, flavour: Flavour) -> bool {
        match self {
            VariantChoice::Auto | VariantChoice::GenericAuto => true,
            VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant) => variant.has(flavour),
        }
    }
}

/// One picture to make.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// Where the camera is.
    pub pose: Pose,
    /// Pixels.
    pub size: [u32; 2],
    /// Which shaders.
    pub variant: VariantChoice,
    /// How stochastic flavours arrive at a value.
    pub estimator: Estimator,
    /// Their noise.
    pub noise: NoiseKind,
    /// Their seed.
    pub seed: u32,
    /// Frame index: the only time there is.
    pub frame: u32,
    /// Full splat with two tiling scales: 96 fetches.
    pub two_tilings: bool,
    /// Shift of the sample points in pixels, for supersampling.
    pub jitter: [f64; 2],
    /// Where in its pixel the terrain is shaded, for temporal supersampling.
    pub sample_pattern: SamplePattern,
    /// Layers wanted besides the picture.
    pub aovs: AovSet,
    /// Whether fetches are counted (a slower shader; never timed).
    pub count_fetches: bool,
    /// Whether the picture is lit; without, only the G-buffer is made.
    pub lit: bool,
    /// Shades the geometry of the last frame again instead of drawing it: for many seeds or variants of one view. Pose, size, jitter,
    /// bias of the LOD, stride of the vertices, the pose culled from and the normals must be those of the last frame, else it is drawn all the same.
    pub keep_geometry: bool,
    /// Bias of the terrain's LOD: each whole one halves the distance at which nodes are split.
    pub lod_bias: f64,
    /// Of the vertices of a node along a side every so many-th is drawn: 1, 2 or 4, see [`geometry::STRIDES`]. The ground's textures stay as fine.
    pub vertex_stride: u32,
    /// Selects nodes and patches as seen from there instead of from the camera: to look at what culling leaves.
    pub culled_from: Option<Pose>,
    /// How the geometry pass stores its two normals.
    pub normals: NormalEncoding,
    /// Whether each variant is shaded, and timed, in a pass of its own; never so where the whole is timed.
    pub time_variants: bool,
}

impl RenderRequest {
    /// A picture with everything at its default: automatic variants, Far Cry 5's estimators, isotropic hashed noise, seed 0.
    pub fn new(pose: Pose, size: [u32; 2]) -> RenderRequest {
        RenderRequest {
            pose,
            size,
            variant: VariantChoice::Auto,
            estimator: Estimator::Fc5,
            noise: NoiseKind::HashedIsotropic,
            seed: 0,
            frame: 0,
            two_tilings: false,
            jitter: [0.0; 2],
            sample_pattern: SamplePattern::Centre,
            aovs: AovSet::default(),
            count_fetches: false,
            lit: true,
            keep_geometry: false,
            lod_bias: 0.0,
            vertex_stride: 1,
            culled_from: None,
            normals: NormalEncoding::default(),
            time_variants: false,
        }
    }
}

impl RenderRequest {
    /// Whether the shading pass has to count fetches and record choices.
    pub fn wants_diagnostics(&self) -> bool {
        self.count_fetches || self.aovs.needs_diagnostics()
    }
}

/// The largest picture side, pixels: 12 bits of tile coordinates would allow more, textures do not.
pub const MAX_SIDE: u32 = 16_384;
/// The largest picture, pixels.
pub const MAX_PIXELS: u64 = 1 << 26;

/// What one frame was made of.
#[derive(Clone, Debug, Default)]
pub struct FrameReport {
    /// Time of each pass on the device.
    pub passes: Vec<PassTime>,
    /// Nodes visited: those drawn, and those above them.
    pub visited: usize,
    /// Nodes that were not resident and were baked for this frame.
    pub loaded: usize,
    /// What edits of the scene had made anew since the frame before.
    pub edited: EditCounts,
    /// Nodes drawn.
    pub nodes: usize,
    /// Patches drawn.
    pub patches: usize,
    /// The nodes drawn, each covering what no other does.
    pub drawn: Vec<NodeId>,
    /// The atlases after this frame's loading.
    pub atlas: AtlasCounts,
    /// Virtual-texture pages.
    pub pages: PageCounts,
    /// The pages kept after this frame's rendering.
    pub page_cache: CacheCounts,
    /// Tiles: all that hold terrain, then per variant 1..=31.
    pub tiles: Vec<u32>,
}

/// Everything of the picture's size.
pub struct Targets {
    /// Of the geometry pass.
    pub geometry: geometry::Targets,
    /// Of the classification pass.
    pub lists: Lists,
    /// Of the shading pass.
    pub shading: shading::Targets,
    /// Linear HDR.
    pub image: wgpu::Texture,
    size: [u32; 2],
}

/// Choices of a renderer that no scene makes: what an experiment varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RendererOptions {
    /// Edge of a tile, pixels: 4, 8 or 16.
    pub tile: u32,
    /// Whether materials, rules and strokes can be changed while the scene is drawn ([`Renderer::retune`]): keeps what textures and nodes were made
    /// from: 110 MB for nodes at most, and twice what the compressed textures take.
    pub editable: bool,
    /// Edge of detail textures, texels, in place of the scene's: for a first look, until [`Renderer::take_palette`] brings the scene's own. For
    /// editable renderers.
    pub sketch: Option<u32>,
}

impl Default for RendererOptions {
    fn default() -> Self {
        RendererOptions { tile: classification::TILE, editable: false, sketch: None }
    }
}

/// A scene on a device, ready to be drawn.
pub struct Renderer<'a> {
    gpu: &'a Gpu,
    scene: Scene,
    options: RendererOptions,
    requirements: Requirements,
    world: World,
    means: PaletteMeans,
    /// What the textures hold, if it can be edited.
    palette: Option<Palette>,
    /// The one before: where two scenes are compared, the other's.
    former: Option<Palette>,
    /// What edits had made anew since the last frame.
    edited: EditCounts,
    streaming: Streaming,
    terrain: Terrain,
    geometry: Geometry,
    virtual_texture: VirtualTexture,
    classification: Classification,
    shading: Shading,
    lighting: Lighting,
    inspect: Inspect,
    composition: Composition,
    /// What the shaders above were made of.
    sources: Arc<Sources>,
    /// Of the last frame's shading.
    keys: Vec<PipelineKey>,
    frame_layout: wgpu::BindGroupLayout,
    targets: Option<Targets>,
    /// How the normals in the targets are stored: passes over the last frame read them so, whatever their request.
    normals: NormalEncoding,
    last: Option<Drawn>,
    progress: &'a (dyn Fn(Progress) + Sync),
}

/// What the geometry targets hold.
struct Drawn {
    /// Pose, size, jitter, bias of the LOD, stride of the vertices, the pose culled from and how normals are stored.
    seen: (Pose, [u32; 2], [f64; 2], f64, u32, Option<Pose>, NormalEncoding),
    visited: Vec<NodeId>,
    nodes: Vec<NodeId>,
    patches: usize,
}

impl<'a> Renderer<'a> {
    /// Makes a scene ready: world, palette, atlases, shaders.
    ///
    /// # Errors
    /// When the scene's data are wrong (file and reason), it asks for cliffs that its world does not have, or a shader does not compile.
    pub fn new(gpu: &'a Gpu, scene: &Scene, progress: &'a (dyn Fn(Progress) + Sync)) -> Result<Renderer<'a>> {
        Renderer::with(gpu, scene, RendererOptions::default(), progress)
    }

    /// As [`Renderer::new`], with options.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with(gpu: &'a Gpu, scene: &Scene, options: RendererOptions, progress: &'a (dyn Fn(Progress) + Sync)) -> Result<Renderer<'a>> {
        let world = World::new(scene)?;
        check_cliffs(scene, &world)?;
        if !classification::TILES.contains(&options.tile) {
            return Err(Error::Request(format!("tiles of {} pixels cannot be had: give 4, 8 or 16", options.tile)));
        }
        let requirements = Requirements::of(scene);
        let size = options.sketch.unwrap_or(scene.detail_size);
        let palette = Palette::sketch(scene, size, world.layout().sector_m, edit::on_texture(progress))?;
        let streaming = Streaming::new(gpu, requirements.colour_modulation, options.editable);
        let terrain = Terrain::new(gpu, &streaming, &palette, scene.blend.anisotropy);
        progress(Progress { stage: "shaders".to_owned(), done: 0, total: 0 });
        let sources = gpu.sources();
        let frame_layout = gpu.layout("frame", wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
        let capacity = if requirements.has(Flavour::VirtualTexture) { virtual_texture::CAPACITY } else { 0 };
        let modulated = requirements.colour_modulation;
        let settings = shading::Settings {
            colour_modulation: modulated,
            anisotropic: scene.blend.anisotropy > 1,
            one_triangle: classification::tile_vertices(gpu) == 3,
            tile: options.tile,
        };
        let renderer = Renderer {
            geometry: Geometry::new(gpu, &frame_layout, &terrain, requirements.holes)?,
            virtual_texture: VirtualTexture::new(gpu, &frame_layout, &terrain, modulated, scene.blend.anisotropy, capacity)?,
            classification: Classification::new(gpu, &frame_layout, options.tile)?,
            shading: Shading::new(gpu, &frame_layout, &terrain, settings)?,
            lighting: Lighting::new(gpu, &frame_layout)?,
            inspect: Inspect::new(gpu, &frame_layout, &terrain)?,
            composition: Composition::new(gpu, &frame_layout, modulated)?,
            sources,
            keys: Vec::new(),
            means: palette_means(&palette),
            palette: options.editable.then_some(palette),
            former: None,
            edited: EditCounts::default(),
            scene: scene.clone(),
            options,
            requirements,
            world,
            streaming,
            terrain,
            gpu,
            frame_layout,
            targets: None,
            normals: NormalEncoding::default(),
            last: None,
            progress,
        };
        // A pipeline that the device refused is this call's failure, not that of the first picture.
        gpu.check()?;
        Ok(renderer)
    }

    /// The world drawn.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The scene drawn.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What the scene requires.
    pub fn requirements(&self) -> &Requirements {
        &self.requirements
    }

    /// The device.
    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }

    /// Elevation of the drawn ground, metres.
    pub fn ground_m(&self, x: f64, y: f64) -> f64 {
        self.world.surface_height_m(x, y)
    }

    /// Mean linear albedo of each material of the scene, tint included: what it looks like from far away.
    pub fn mean_albedos(&self) -> &[[f32; 3]] {
        &self.means.albedo
    }

    /// The page of the virtual texture that served the last frame where it asked for `page`; `None` where none did.
    pub fn page_serving(&self, page: virtual_texture::PageId) -> Option<virtual_texture::PageId> {
        self.virtual_texture.serving(page)
    }

    /// The targets of the last frame, for tests and inspection.
    pub fn targets(&self) -> Option<&Targets> {
        self.targets.as_ref()
    }

    /// The request's view of this world.
    pub fn view(&self, request: &RenderRequest) -> View {
        let layout = self.world.layout();
        View::new(request.pose, request.size, request.jitter, layout.sector_m, layout.world_m())
    }

    /// Makes one picture.
    ///
    /// # Errors
    /// When the size is out of range, the view needs more nodes than fit, or the device fails.
    pub fn render(&mut self, request: &RenderRequest) -> Result<Picture> {
        let report = self.draw(request)?;
        Picture::read(self, request, report)
    }

    /// Draws one frame and leaves it on the device: the stages in their order.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw(&mut self, request: &RenderRequest) -> Result<FrameReport> {
        check_size(request.size, &self.gpu.device.limits(), self.options.tile)?;
        self.check_variant(request.variant)?;
        let [finest, coarsest] = quadtree::LOD_BIASES;
        if !(finest..=coarsest).contains(&request.lod_bias) {
            return Err(Error::Request(format!("an LOD bias of {} cannot be drawn: give {finest} to {coarsest}", request.lod_bias)));
        }
        if !geometry::STRIDES.contains(&request.vertex_stride) {
            return Err(Error::Request(format!("every {}th vertex cannot be drawn: give 1, 2 or 4", request.vertex_stride)));
        }
        let gpu = self.gpu;
        let fits = |t: &Targets| t.size == request.size && t.geometry.normals.format() == request.normals.format();
        if !self.targets.as_ref().is_some_and(fits) {
            self.last = None;
            self.targets = Some(Targets::new(gpu, request.size, request.normals, self.options.tile));
        }
        self.normals = request.normals;
        let targets = self.targets.take().expect("made just above");
        let report = self.draw_into(request, &targets);
        self.targets = Some(targets);
        report
    }

    /// Refuses to force what the scene has no textures for.
    fn check_variant(&self, choice: VariantChoice) -> Result<()> {
        let (VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant)) = choice else { return Ok(()) };
        if variant.has(Flavour::VirtualTexture) && !self.requirements.has(Flavour::VirtualTexture) {
            return Err(Error::Request(format!(
                "scene `{}` has no virtual texture, so `{variant}` cannot be forced: set flavours.far_atlas_m above 0, or leave out vt",
                self.scene.name
            )));
        }
        Ok(())
    }

    fn draw_into(&mut self, request: &RenderRequest, targets: &Targets) -> Result<FrameReport> {
        let gpu = self.gpu;
        let view = self.view(request);

        let frame = self.frame_group(request);
        let terrain_group = self.terrain.group.clone();
        let groups = [&frame, &terrain_group];
        let mut timer = Timer::new(gpu);
        let mut encoder = gpu.encoder("geometry");

        let &RenderRequest { pose, size, jitter, lod_bias, vertex_stride, culled_from, normals, .. } = request;
        let seen = (pose, size, jitter, lod_bias, vertex_stride, culled_from, normals);
        // Where the geometry is kept, nothing is loaded.
        let mut loaded = 0;
        let drawn = match self.last.take().filter(|d| request.keep_geometry && d.seen == seen) {
            Some(drawn) => drawn,
            None => {
                // streaming, quadtree: which nodes, and their payloads; culling: patches
                let eye = culled_from.map_or(view, |pose| self.view(&RenderRequest { pose, ..request.clone() }));
                let (visited, drawn, patches) = self.visible_patches(request, &view, &eye)?;
                loaded = self.streaming.loaded();
                // geometry: depth, stencil, mask, normals
                self.geometry.encode(gpu, &mut encoder, &mut timer, groups, &patches, vertex_stride, &targets.geometry);
                Drawn { seen, visited, nodes: drawn, patches: patches.len() }
            }
        };
        // classification: tiles per variant; requests: visible virtual-texture pages
        self.classification.encode(gpu, &mut encoder, &mut timer, &frame, &targets.geometry, &targets.lists);
        let has_pages = self.virtual_texture.is_required() && request.variant.may_use(Flavour::VirtualTexture);
        if has_pages {
            self.virtual_texture.encode_requests(gpu, &mut encoder, &mut timer, groups, &targets.geometry);
        }
        gpu.submit_and_wait(encoder)?;
        let tiles = targets.lists.read_counts(gpu)?;

        // virtual texture: pages that are missing
        let pages = if has_pages {
            let sources: Vec<(NodeId, u64)> = drawn.visited.iter().map(|&node| (node, self.streaming.revision(node))).collect();
            self.virtual_texture.fill(gpu, groups, self.world.layout(), &sources, view.sector)?
        } else {
            PageCounts::default()
        };

        // shading: G-buffer, by the variants that have tiles; lighting: linear HDR
        let keys = self.warm(request, &tiles)?;
        let mut encoder = gpu.encoder("shading");
        self.shading.encode(
            gpu,
            &mut encoder,
            &mut timer,
            groups,
            &targets.geometry,
            &targets.lists,
            &self.virtual_texture,
            &targets.shading,
            &keys,
            request.wants_diagnostics(),
            request.time_variants,
        );
        if request.lit {
            self.lighting.encode(gpu, &mut encoder, &mut timer, &frame, &targets.geometry, &targets.shading, &targets.image);
        }
        timer.resolve(&mut encoder);
        gpu.submit_and_wait(encoder)?;

        let report = FrameReport {
            passes: timer.read(gpu)?,
            visited: drawn.visited.len(),
            loaded,
            edited: std::mem::take(&mut self.edited),
            nodes: drawn.nodes.len(),
            patches: drawn.patches,
            drawn: drawn.nodes.clone(),
            atlas: self.streaming.counts(),
            pages,
            page_cache: self.virtual_texture.cache_counts(),
            tiles: tiles.to_vec(),
        };
        self.last = Some(drawn);
        Ok(report)
    }

    /// The uniforms of a request, bound.
    fn frame_group(&self, request: &RenderRequest) -> wgpu::BindGroup {
        let uniforms = self.uniforms(request, &self.view(request));
        let buffer = self.gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
        self.gpu.group("frame", &self.frame_layout, &[buffer.as_entire_binding()])
    }

    /// Shades one view by each flavour of `flavours` alone, on every pixel, and keeps the results in their layers: what pictures of any variant are
    /// composed from. Fetches and choices are counted. The geometry of the last frame serves again if the view is the same.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw_flavours(&mut self, request: &RenderRequest, flavours: Variant, layers: &Layers) -> Result<()> {
        for flavour in flavours.flavours() {
            let variant = VariantChoice::Forced(Variant::only(flavour));
            self.draw(&RenderRequest { variant, count_fetches: true, lit: false, keep_geometry: true, ..request.clone() })?;
            let targets = self.targets.as_ref().expect("just drawn into");
            let mut encoder = self.gpu.encoder("flavour layer");
            layers.capture(&mut encoder, flavour, &targets.shading);
            self.gpu.queue.submit([encoder.finish()]);
        }
        Ok(())
    }

    /// Follows streams of this renderer's pictures over frames.
    ///
    /// # Errors
    /// When a shader does not compile or the device has not the memory.
    pub fn meter(&self, size: [u32; 2], resolves: &[Resolve]) -> Result<Meter> {
        Meter::new(self.gpu, &self.frame_layout, size, resolves)
    }

    /// Follows surface points from one picture of this renderer to the next.
    ///
    /// # Errors
    /// When the shader does not compile or the device has not the memory.
    pub fn links(&self, size: [u32; 2]) -> Result<Links> {
        Links::new(self.gpu, &self.frame_layout, size)
    }

    /// Where each pixel's surface point of the last frame drawn, which `request` made, was in the one that `links` was last asked for.
    ///
    /// # Errors
    /// When nothing of that size was drawn yet or the device fails.
    pub fn link(&self, request: &RenderRequest, links: &mut Links) -> Result<Vec<u32>> {
        let targets = self.targets.as_ref().filter(|t| t.size == links.size());
        let targets = targets.ok_or_else(|| Error::Request("nothing of this size has been drawn yet".to_owned()))?;
        links.find(self.gpu, &self.frame_group(request), &targets.geometry, self.view(request))
    }

    /// Composes pictures of the last frame drawn, which `request` made, from its flavours' layers: each stream into its buffer.
    ///
    /// # Errors
    /// When nothing was drawn yet or the device fails.
    pub fn compose(&self, request: &RenderRequest, layers: &Layers, destinations: &[Destination<'_>]) -> Result<()> {
        let targets = self.targets.as_ref().ok_or_else(|| Error::Request("nothing has been drawn yet".to_owned()))?;
        let frame = self.frame_group(request);
        let mut encoder = self.gpu.encoder("composition");
        self.composition.encode(self.gpu, &mut encoder, &frame, &targets.geometry, layers, destinations);
        self.gpu.submit_and_wait(encoder)
    }

    /// Composes the streams of `meter` (`variants`: one each, `None` = each pixel what it needs) from the last frame drawn, which `request` made, and
    /// measures them against the frames before.
    ///
    /// # Errors
    /// When nothing was drawn yet or the device fails.
    pub fn measure(
        &self,
        request: &RenderRequest,
        layers: &Layers,
        meter: &mut Meter,
        variants: &[Option<Variant>],
    ) -> Result<(Vec<FrameSums>, Vec<PassTime>)> {
        let gpu = self.gpu;
        let targets = self.targets.as_ref().ok_or_else(|| Error::Request("nothing has been drawn yet".to_owned()))?;
        let frame = self.frame_group(request);
        let view = self.view(request);
        let mut timer = Timer::new(gpu);
        let mut encoder = gpu.encoder("metrics");
        let slots = meter.slots();
        meter.motion.encode(gpu, &mut encoder, &mut timer, &frame, &targets.geometry, &view, &slots);
        let destinations: Vec<_> = variants
            .iter()
            .zip(&meter.streams)
            .map(|(&v, s)| Destination { stream: self.composition.stream(v), signal: &s.signal, offset: slots.now })
            .collect();
        self.composition.encode(gpu, &mut encoder, &frame, &targets.geometry, layers, &destinations);
        meter.encode(gpu, &mut encoder, &mut timer);
        timer.resolve(&mut encoder);
        gpu.submit_and_wait(encoder)?;
        let sums = meter.read(gpu)?;
        meter.motion.advance(view);
        Ok((sums, timer.read(gpu)?))
    }

    /// The pass that composes pictures, for its streams.
    pub fn composition(&self) -> &Composition {
        &self.composition
    }

    /// The nodes that `eye` visits (made resident), those of them it draws, and the patches of those that it may see, placed for `view`.
    fn visible_patches(&mut self, request: &RenderRequest, view: &View, eye: &View) -> Result<(Vec<NodeId>, Vec<NodeId>, Vec<Patch>)> {
        self.streaming.begin_frame();
        let (streaming, world, means, progress, gpu) = (&mut self.streaming, &self.world, &self.means, self.progress, self.gpu);
        let done = AtomicU64::new(0);
        let selection = quadtree::select(world, eye, request.lod_bias, |nodes| {
            let on_baked = || {
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(Progress { stage: "terrain nodes".to_owned(), done, total: 0 });
            };
            streaming.load(gpu, world, means, nodes, &on_baked)
        })?;
        let slots = selection.visited.iter().filter_map(|&n| Some((n, self.streaming.get(n)?.0)));
        self.terrain.update(gpu, slots);
        let drawn: Vec<_> = selection.drawn.iter().filter_map(|&n| self.streaming.get(n).map(|(slot, bounds)| (n, slot, bounds))).collect();
        let lod_map = quadtree::lod_map(&selection.drawn);
        let patches = culling::cull(&drawn, &lod_map, self.world.layout(), [view, eye], request.vertex_stride);
        let drawn = drawn.into_iter().map(|(node, ..)| node).collect();
        Ok((selection.visited, drawn, patches))
    }

    /// Runs the inspection pass over the last frame, which `request` made.
    ///
    /// # Errors
    /// When there is no frame yet or the device fails.
    pub fn inspect(&self, request: &RenderRequest) -> Result<Vec<crate::inspect::Inspected>> {
        let targets = self.targets.as_ref().ok_or_else(|| Error::Request("nothing has been drawn yet".to_owned()))?;
        let frame = self.frame_group(request);
        self.inspect.run(self.gpu, [&frame, &self.terrain.group], &targets.geometry)
    }

    /// Builds the pipelines that a request needs for the tiles there are (all 31 lists and the generic one's), and returns their keys.
    ///
    /// # Errors
    /// When one cannot be built.
    fn warm(&mut self, request: &RenderRequest, tiles: &[u32]) -> Result<Vec<PipelineKey>> {
        let has_tiles = |mask: usize| tiles.get(mask).is_some_and(|&n| n > 0);
        let kernels: Vec<Kernel> = match request.variant {
            VariantChoice::Auto | VariantChoice::Forced(_) => {
                Variant::all().filter(|v| has_tiles(usize::from(v.mask()))).map(Kernel::Variant).collect()
            }
            VariantChoice::GenericAuto | VariantChoice::GenericForced(_) => vec![Kernel::Generic],
        };
        let keys: Vec<PipelineKey> = kernels
            .into_iter()
            .map(|kernel| PipelineKey {
                kernel,
                estimator: request.estimator,
                noise: request.noise,
                two_tilings: request.two_tilings,
                diagnostics: request.wants_diagnostics(),
            })
            .map(PipelineKey::canonical)
            .collect();
        let total = keys.len() as u64;
        for (done, &key) in (0..).zip(&keys) {
            if self.shading.warm(self.gpu, key)? {
                (self.progress)(Progress { stage: "shader variants".to_owned(), done, total });
            }
        }
        // Those of one view, by whatever it was shaded; what is not lit is for nobody to see.
        if request.lit && !request.keep_geometry {
            self.keys.clear();
        }
        let fresh = keys.iter().filter(|key| request.lit && !self.keys.contains(key)).copied().collect::<Vec<_>>();
        self.keys.extend(fresh);
        Ok(keys)
    }

    #[allow(clippy::cast_possible_truncation, reason = "uniforms are f32 on purpose")]
    fn uniforms(&self, request: &RenderRequest, view: &View) -> FrameUniforms {
        let (low, high) = self.world.height_range_m();
        let (sun, sky, blend) = (&self.scene.sun, &self.scene.sky, &self.scene.blend);
        let (azimuth, elevation) = (sun.azimuth_deg.to_radians(), sun.elevation_deg.to_radians());
        let sun_direction = DVec3::new(azimuth.sin() * elevation.cos(), azimuth.cos() * elevation.cos(), elevation.sin());
        let f = |v: DVec3| v.as_vec3().to_array();
        FrameUniforms {
            clip_from_local: view.clip_from_local_f32().to_cols_array_2d(),
            camera: f(view.camera),
            sector_m: self.world.layout().sector_m as f32,
            ray_00: f(view.ray_00),
            near_m: NEAR_M as f32,
            ray_dx: f(view.ray_dx),
            height_low_m: low as f32,
            ray_dy: f(view.ray_dy),
            height_span_m: (high - low) as f32,
            camera_sector: view.sector.to_array(),
            size: view.size,
            seed: request.seed,
            frame: request.frame,
            forced_mask: match request.variant {
                VariantChoice::Forced(v) | VariantChoice::GenericForced(v) => u32::from(v.mask()),
                VariantChoice::Auto | VariantChoice::GenericAuto => 0,
            },
            page_levels: virtual_texture::LEVELS,
            tiles: classification::tiles_of(view.size, self.options.tile),
            hash_scale: blend.hash_scale as f32,
            height_sharpness: blend.height_sharpness as f32,
            triplanar_sharpness: blend.triplanar_sharpness as f32,
            gradient_scale: blend.mip_bias.exp2() as f32,
            page_texels_per_m: virtual_texture::TEXELS_PER_M as f32,
            page_anisotropy: f32::from(virtual_texture::anisotropy(blend.anisotropy)),
            flavours: FlavourParams::new(&self.scene.flavours),
            sun_direction: f(sun_direction),
            taps: 4,
            sun_irradiance: sun.irradiance.map(|v| v as f32),
            noise_world_level: noise::WORLD_LEVEL,
            sky_zenith: sky.zenith.map(|v| v as f32),
            sample_pattern: request.sample_pattern.code(),
            sky_horizon: sky.horizon.map(|v| v as f32),
            normals: self.normals.code(),
        }
    }
}

impl Targets {
    fn new(gpu: &Gpu, size: [u32; 2], normals: NormalEncoding, tile: u32) -> Targets {
        Targets {
            geometry: geometry::Targets::new(gpu, size, normals),
            lists: Lists::new(gpu, size, tile),
            shading: shading::Targets::new(gpu, size),
            image: gpu.target("image", size, lighting::FORMAT),
            size,
        }
    }
}

/// Refuses cliffs that the world does not have.
fn check_cliffs(scene: &Scene, world: &World) -> Result<()> {
    // How steep the world is takes a tenth of a second to say, and is wanted only where it may be too little.
    let asked = scene.flavours.cliff_slope_deg;
    if !scene.flavours.has_cliffs() || world.is_as_steep_as(asked) {
        Ok(())
    } else {
        scene::validate_against_world(scene, world.max_slope_deg())
    }
}

/// Refuses sizes that no picture can have on a device with these limits.
///
/// # Errors
/// When a side is 0 or above [`MAX_SIDE`], there are more than [`MAX_PIXELS`], or the device cannot hold the targets or tile lists.
pub fn check_size(size: [u32; 2], limits: &wgpu::Limits, tile: u32) -> Result<()> {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let side = MAX_SIDE.min(limits.max_texture_dimension_2d);
    let [columns, rows] = classification::tiles_of(size, tile).map(u64::from);
    let lists = columns * rows * u64::from(classification::LISTS) * 4;
    if size.contains(&0) || size.iter().any(|&n| n > side) || pixels > MAX_PIXELS || lists > limits.max_storage_buffer_binding_size {
        return Err(Error::Request(format!(
            "a picture of {}x{} cannot be made here: each side must be 1 to {side} pixels, {MAX_PIXELS} in all; make it smaller",
            size[0], size[1]
        )));
    }
    Ok(())
}
