//! The frame: [`Renderer::draw`] calls the stages that make a picture, in order. Results of a stage are arguments of later stages.

use std::sync::Arc;
use std::time::Instant;

use crate::base::cache::Cache;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::base::section::{Section, mebibytes, row};
use crate::classification;
use crate::composition::{Composition, Layers};
use crate::culling::{self, Conditions, CullCounts, Culled, DrawnNode, Levels};
use crate::geometry::surface::Surface;
use crate::gpu::bindings::Binding;
use crate::gpu::{Gpu, Recording, Sources};
use crate::materials::Palette;
use crate::metrics::{Meter, Track, Viewing};
use crate::motion::Links;
use crate::quadtree::{self, Lag};
use crate::residency::Streaming;
use crate::scene::demands::Demands;
use crate::scene::{self, Scene};
use crate::shading::{Kernel, PipelineKey, ShadingPass};
use crate::stage::{Build, Canvas};
use crate::terrain::{Terrain, palette_means};
use crate::variant::{Flavour, Variant};
use crate::view::camera::View;
use crate::virtual_texture;
use crate::world::{NodeId, PaletteMeans, World};

mod arrive;
mod drawn;
mod edit;
pub mod export;
pub mod picture;
mod reload;
mod report;
mod request;
pub mod requirements;
mod settings;
mod stages;
mod uniforms;

pub use drawn::{DrawnGeometry, Frame};
pub use edit::EditCounts;
pub use reload::ReloadReport;
pub use report::FrameReport;
pub use request::{
    GeometryKey, GeometryRequest, MAX_PIXELS, MAX_SIDE, Outputs, RenderRequest, ShadingRequest, VariantChoice, ViewRequest, check_size,
};
pub use settings::{ClassifyBy, FRAME, FrameSettings, setting, settings};
pub use stages::{DECLARATIONS, FOLLOWING, StageSettings, Targets, shader_files, stage_settings};

use picture::Picture;
use stages::Stages;

/// Options of a renderer, which are not part of the scene.
#[derive(Clone, Debug)]
pub struct RendererOptions {
    /// Edge length of a tile, pixels: 4, 8 or 16.
    pub tile: u32,
    /// Whether materials, rules and strokes can be changed while the scene is drawn ([`Renderer::retune`]). An editable renderer keeps
    /// additional data in main memory: the data from which node payloads are made (at most 130 MB), and the compressed detail textures of the current
    /// and of the former palette.
    pub editable: bool,
    /// Edge of the detail textures of a quick preview, texels. These textures are used until [`Renderer::take_palette`] sets textures of the size
    /// that the scene gives. `None` = no preview: from the start, the textures have the size that the scene gives. Only for editable renderers.
    pub sketch: Option<u32>,
    /// Where baked nodes and procedural textures are kept for the next start; `None` = they are not kept.
    pub cache: Option<Arc<Cache>>,
}

/// No editing, no preview, and the cache of the user ([`Cache::of_user`]).
impl Default for RendererOptions {
    fn default() -> Self {
        RendererOptions { tile: classification::TILE, editable: false, sketch: None, cache: Cache::of_user() }
    }
}

/// A scene on a device, ready to be drawn.
pub struct Renderer<'a> {
    gpu: Gpu,
    scene: Scene,
    options: RendererOptions,
    demands: Demands,
    world: Arc<World>,
    means: PaletteMeans,
    /// The palette of the textures, if the renderer is editable.
    palette: Option<Palette>,
    /// The palette before the current one. A comparison of two scenes, A and B, switches between two palettes, so the textures of the former palette
    /// can be reused.
    former: Option<Palette>,
    /// Counts of the nodes and texture layers that edits have caused to be rebuilt since the last frame.
    edited: EditCounts,
    streaming: Streaming,
    arrived: arrive::Arrived,
    terrain: Terrain,
    stages: Stages,
    /// The shader texts that replaced embedded texts when the stages were built or last reloaded.
    sources: Arc<Sources>,
    frame_layout: wgpu::BindGroupLayout,
    targets: Option<Targets>,
    /// Contents of the geometry targets; `None` = they hold nothing that can be reused.
    drawn: Option<Drawn>,
    progress: &'a (dyn Fn(Progress) + Sync),
}

/// Contents of the geometry targets.
struct Drawn {
    key: GeometryKey,
    visited: Vec<NodeId>,
    nodes: Vec<NodeId>,
    levels: Arc<Levels>,
    patches: usize,
    triangles: usize,
    culled: CullCounts,
    lag: Lag,
}

/// The nodes of a frame.
struct Selected {
    /// All visited nodes; they are resident.
    visited: Vec<NodeId>,
    /// The nodes to draw.
    drawn: Vec<NodeId>,
    /// The levels of the patches of the nodes to draw.
    levels: Levels,
    /// How much coarser the nodes to draw are than they would be if all nodes were available.
    lag: Lag,
}

impl<'a> Renderer<'a> {
    /// Prepares a scene for drawing: world, palette, atlases, shaders.
    ///
    /// # Errors
    /// When data of the scene cannot be read or used, the cliffs of the scene begin at a slope that its world does not reach, a shader does not
    /// compile, or the device fails.
    pub fn new(gpu: &Gpu, scene: &Scene, progress: &'a (dyn Fn(Progress) + Sync)) -> Result<Renderer<'a>> {
        Renderer::with(gpu, scene, RendererOptions::default(), progress)
    }

    /// Does the same as [`Renderer::new`], with options.
    ///
    /// # Errors
    /// The same errors as [`Renderer::new`], and an error if `options.tile` is not a possible edge of a tile.
    pub fn with(gpu: &Gpu, scene: &Scene, options: RendererOptions, progress: &'a (dyn Fn(Progress) + Sync)) -> Result<Renderer<'a>> {
        let world = World::new(scene)?.with_cache(options.cache.clone());
        check_cliffs(scene, &world)?;
        FrameSettings { tile: options.tile, ..FrameSettings::default() }.check().map_err(|wrong| Error::Request(wrong.to_string()))?;
        let demands = demands_on(gpu, scene);
        let size = options.sketch.unwrap_or(scene.detail_size);
        let palette = Palette::kept(scene, size, world.layout().sector_m, options.cache.as_deref(), edit::on_texture(progress))?;
        let streaming = Streaming::new(gpu, demands.colour_modulation, options.editable);
        let terrain = Terrain::new(gpu, &streaming, &palette, demands.anisotropy);
        progress(Progress { stage: "shaders".to_owned(), done: 0, total: 0 });
        let sources = gpu.sources();
        let frame_layout = gpu.layout("frame", wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
        let stages = Stages::build(Build { gpu, frame: &frame_layout, terrain: &terrain, demands: &demands, tile: options.tile })?;
        // An error of the device while the stages were built is reported at this point and not with the first picture.
        gpu.check()?;
        Ok(Renderer {
            gpu: gpu.clone(),
            scene: scene.clone(),
            demands,
            world: Arc::new(world),
            means: palette_means(&palette),
            palette: options.editable.then_some(palette),
            options,
            former: None,
            edited: EditCounts::default(),
            streaming,
            arrived: arrive::Arrived::default(),
            terrain,
            stages,
            sources,
            frame_layout,
            targets: None,
            drawn: None,
            progress,
        })
    }

    /// The parts from which stages are built.
    fn build(&self) -> Build<'_> {
        Build { gpu: &self.gpu, frame: &self.frame_layout, terrain: &self.terrain, demands: &self.demands, tile: self.options.tile }
    }

    /// The world that is drawn.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Where baked nodes and procedural textures are kept; `None` = they are not kept.
    pub fn cache(&self) -> Option<&Arc<Cache>> {
        self.options.cache.as_ref()
    }

    /// The scene that is drawn.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The demands of the scene: the flavours, textures and features that the stages must provide.
    pub fn demands(&self) -> &Demands {
        &self.demands
    }

    /// The device that draws.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Elevation of the ground at the world position (`x`, `y`), metres, as drawn at the finest LOD and vertex stride 1. Holes are ignored.
    /// [`Renderer::drawn_ground_m`] returns the elevation as a request draws it.
    pub fn ground_m(&self, x: f64, y: f64) -> f64 {
        self.world.surface_height_m(x, y)
    }

    /// Mean linear albedo of each material of the scene, tint included. The colours of the far atlas are computed from these values.
    pub fn mean_albedos(&self) -> &[[f32; 3]] {
        &self.means.albedo
    }

    /// Returns the page of the virtual texture that the last frame used for the area of `page`: `page` itself or, if the frame did not use it, the
    /// finest coarser page that contains it and that the frame used. `None` = the frame used no such page.
    pub fn page_serving(&self, page: virtual_texture::PageId) -> Option<virtual_texture::PageId> {
        self.stages.virtual_texture.serving(page)
    }

    /// The view of this world that the request describes.
    pub fn view(&self, request: &RenderRequest) -> View {
        let (layout, view) = (self.world.layout(), &request.view);
        View::new(view.pose, view.size, view.jitter, layout.sector_m, layout.world_m())
    }

    /// Draws one picture and reads it back.
    ///
    /// # Errors
    /// When [`RenderRequest::check`] refuses the request, it forces the flavour `vt` in a scene without a virtual texture, its residency belongs to
    /// an earlier frame of simulated streaming ([`Renderer::arrive`]), the view needs more nodes than fit in the atlases, a pipeline cannot be
    /// built, or the device fails.
    pub fn render(&mut self, request: &RenderRequest) -> Result<Picture> {
        self.draw(request)?.read()
    }

    /// Draws one frame, which stays on the device.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`].
    pub fn draw(&mut self, request: &RenderRequest) -> Result<Frame<'_, 'a>> {
        let report = self.draw_targets(request)?;
        let targets = self.targets.as_ref().expect("a frame was drawn into the targets");
        Ok(Frame::new(self, targets, *request, report))
    }

    /// Draws one frame into the targets, which are allocated again if their size or format differs.
    fn draw_targets(&mut self, request: &RenderRequest) -> Result<FrameReport> {
        request.check(&self.gpu.device.limits(), self.options.tile)?;
        self.check_variant(request.shading.variant)?;
        let (size, normals) = (request.view.size, request.geometry.normals);
        let targets = match self.targets.take().filter(|targets| targets.fit(size, normals)) {
            Some(targets) => targets,
            None => {
                self.drawn = None;
                Targets::new(Canvas { gpu: &self.gpu, size, normals, tile: self.options.tile })
            }
        };
        let report = self.draw_into(request, &targets);
        self.targets = Some(targets);
        report
    }

    /// Calls the stages in order.
    fn draw_into(&mut self, request: &RenderRequest, targets: &Targets) -> Result<FrameReport> {
        let gpu = self.gpu.clone();
        let gpu = &gpu;
        let view = self.view(request);
        let (frame, terrain) = (self.frame_group(request), self.terrain.group.clone());
        let groups = [&frame, &terrain];
        let mut rec = Recording::new(gpu, &groups);

        let key = request.geometry_key();
        // If the geometry is reused, no nodes are loaded.
        let mut loaded = 0;
        let mut selection_ms = 0.0;
        let mut listed = None;
        let mut drawn = match self.drawn.take().filter(|drawn| request.outputs.keep_geometry && drawn.key == key) {
            Some(drawn) => drawn,
            None => {
                // Stages `quadtree` and `residency`: select the nodes and load their payloads. Stage `culling`: select the patches.
                let began = Instant::now();
                let eye = self.eye(request);
                let selected = self.select(request, &eye)?;
                let culled = self.visible_patches(request, &selected, [&view, &eye]);
                loaded = self.streaming.take_loaded();
                // Stage `geometry`: write depth, stencil, mask and normals.
                let hides = request.geometry.culls.hides() && request.geometry.culled_from.is_none();
                let list = self.stages.geometry.list(gpu, &culled, hides);
                selection_ms = began.elapsed().as_secs_f64() * 1e3;
                self.stages.geometry.encode(&mut rec, &list, 0, &targets.geometry);
                // Stage `occlusion`: drop the patches that are hidden by what was drawn, phase by phase.
                for phase in 1..list.phases {
                    self.stages.occlusion.encode(&mut rec, &targets.geometry, &targets.occlusion, &list, phase);
                    self.stages.geometry.encode(&mut rec, &list, phase, &targets.geometry);
                }
                let drawn = Drawn {
                    key,
                    visited: selected.visited,
                    nodes: selected.drawn,
                    levels: Arc::new(selected.levels),
                    patches: culled.patches.len(),
                    triangles: 0,
                    culled: culled.counts,
                    lag: selected.lag,
                };
                listed = Some(list);
                drawn
            }
        };
        // Stage `classification`: list the tiles of each variant. Stage `virtual_texture`: request the visible pages.
        self.stages.classification.encode(&mut rec, &targets.geometry, &targets.classification);
        let has_pages = self.stages.virtual_texture.is_required() && request.shading.variant.may_use(Flavour::VirtualTexture);
        if has_pages {
            self.stages.virtual_texture.encode_requests(&mut rec, &targets.geometry);
        }
        rec.submit()?;
        let tiles = self.stages.classification.read_counts(gpu, &targets.classification)?;
        if let Some(list) = listed {
            let [visible, triangles] = list.read_drawn(gpu)?.map(|count| count as usize);
            drawn.triangles = triangles;
            drawn.culled.hidden = drawn.patches.saturating_sub(visible);
            drawn.patches = visible;
        }

        // Stage `virtual_texture`: render the requested pages that are not cached.
        let pages = if has_pages {
            let sources: Vec<(NodeId, u64)> = drawn.visited.iter().map(|&node| (node, self.streaming.revision(node))).collect();
            self.stages.virtual_texture.fill(gpu, groups, self.world.layout(), &sources, view.sector)?
        } else {
            self.stages.virtual_texture.rest()
        };

        // Stage `shading`: write the G-buffer, by the variants that have tiles or by the generic kernel. Stage `lighting`: write linear HDR.
        let keys = self.warm(request, &tiles)?;
        let how = ShadingPass { keys: &keys, diagnostics: request.wants_diagnostics(), timed: request.outputs.time_variants };
        let pages_of_frame = &self.stages.virtual_texture;
        self.stages.shading.encode(&mut rec, &targets.geometry, &targets.classification, pages_of_frame, how, &targets.shading);
        if request.outputs.lit {
            self.stages.lighting.encode(&mut rec, &targets.geometry, &targets.shading, &targets.lighting);
        }
        // Stage `display`: write tone-mapped sRGB.
        if request.is_displayed() {
            self.stages.display.encode(&mut rec, request.stages.display, &targets.lighting, &targets.display);
        }

        let report = FrameReport {
            passes: rec.finish()?,
            selection_ms,
            visited: drawn.visited.len(),
            loaded,
            edited: std::mem::take(&mut self.edited),
            nodes: drawn.nodes.len(),
            patches: drawn.patches,
            triangles: drawn.triangles,
            culled: drawn.culled,
            lag: drawn.lag,
            drawn: drawn.nodes.clone(),
            levels: Arc::clone(&drawn.levels),
            atlas: self.streaming.counts(),
            pages,
            page_cache: self.stages.virtual_texture.cache_counts(),
            tiles: tiles.to_vec(),
            sections: self.sections(&drawn, loaded),
        };
        self.drawn = Some(drawn);
        Ok(report)
    }

    /// Returns the numbers of the frame, for display: first the numbers of nodes, patches and atlases, then the numbers of each stage.
    fn sections(&self, drawn: &Drawn, loaded: usize) -> Vec<Section> {
        let atlas = self.streaming.counts();
        let is_stopped = self.options.cache.as_ref().is_some_and(|cache| cache.problem().is_some());
        let mut sections = vec![
            Section {
                name: "Nodes and patches",
                about: "Quadtree, culling and occlusion: nodes are visited from the coarsest down, and each selected node is divided into 8 x 8 patches of 16 x 16 quads",
                rows: vec![
                    row("Nodes visited", drawn.visited.len()),
                    row("Nodes selected", drawn.nodes.len()),
                    row("Ground drawn too coarse, because nodes have not arrived", format!("{:.1} %", 100.0 * drawn.lag.share)),
                    row("Patches drawn", drawn.patches),
                    row("Triangles drawn", drawn.triangles),
                    row("Patches outside the frustum", drawn.culled.outside),
                    row("Patches that face away", drawn.culled.facing_away),
                    row("Patches that are hidden", drawn.culled.hidden),
                ],
            },
            Section {
                name: "Atlas",
                about: "Residency: each visited node is stored in a slot (array layer) of the atlases; if no slot is free, the least recently used node is replaced",
                rows: [
                    row("Slots used", format!("{} of {}", atlas.resident, atlas.capacity)),
                    row("Nodes loaded for this frame", loaded),
                    row("Memory of the atlases", mebibytes(atlas.bytes)),
                ]
                .into_iter()
                .chain(is_stopped.then(|| row("Nothing is kept on disk", "set SCREE_CACHE to another folder")))
                .collect(),
            },
        ];
        sections.extend(self.stages.sections());
        sections
    }

    /// Draws the view once for each flavour (shading technique) in `flavours`. Each time, all terrain pixels are shaded by this flavour alone, and
    /// the result is copied into `layers`. The picture of any variant, a set of flavours, can be composed from these layers if `flavours` contains
    /// the set. The passes count fetches and record the first random choice of each pixel. The geometry of the last frame is reused if its
    /// [`GeometryKey`] is the same.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`].
    pub fn draw_flavours(&mut self, request: &RenderRequest, flavours: Variant, layers: &Layers) -> Result<DrawnGeometry<'_, 'a>> {
        for flavour in flavours.flavours() {
            self.draw_targets(&request.with(|r| {
                r.shading.variant = VariantChoice::Forced(Variant::only(flavour));
                r.outputs.count_fetches = true;
                r.outputs.lit = false;
                r.outputs.keep_geometry = true;
            }))?;
            let targets = self.targets.as_ref().expect("a frame was drawn into the targets");
            let mut encoder = self.gpu.encoder("flavour layer");
            layers.capture(&mut encoder, flavour, &targets.shading);
            self.gpu.queue.submit([encoder.finish()]);
        }
        let targets = self.targets.as_ref().expect("a variant has at least one flavour, so a frame was drawn");
        Ok(DrawnGeometry::new(self, targets, *request))
    }

    /// Returns the geometry of the last frame drawn, which must be the geometry of `request`.
    ///
    /// # Errors
    /// When nothing was drawn yet, the last frame had a different geometry, or its geometry was discarded since, for example by
    /// [`Renderer::drawn_ground_m`] or [`Renderer::retune`].
    pub fn drawn_as(&self, request: &RenderRequest) -> Result<DrawnGeometry<'_, 'a>> {
        match (&self.targets, &self.drawn) {
            (Some(targets), Some(drawn)) if drawn.key == request.geometry_key() => Ok(DrawnGeometry::new(self, targets, *request)),
            _ => Err(Error::Request("this view is not the one that was drawn last: draw it first".to_owned())),
        }
    }

    /// Makes a meter, which measures how the pictures of this renderer change over frames. Each entry of `tracks` describes one stream, a sequence of
    /// pictures that the meter follows. `viewing`: the viewing conditions; needed if errors are measured against a reference sequence.
    ///
    /// # Errors
    /// When a shader does not compile or the device is out of memory.
    pub fn meter(&self, size: [u32; 2], tracks: &[Track], viewing: Option<Viewing>) -> Result<Meter> {
        Meter::new(&self.gpu, &self.frame_layout, size, tracks, viewing)
    }

    /// Makes [`Links`], which find for each pixel of a frame the pixel of the previous frame that showed the same surface point.
    ///
    /// # Errors
    /// When the shader does not compile or the device is out of memory.
    pub fn links(&self, size: [u32; 2]) -> Result<Links> {
        Links::new(&self.gpu, &self.frame_layout, size)
    }

    /// The pass that composes pictures. Its method [`Composition::stream`] describes how the picture of a variant is composed.
    pub fn composition(&self) -> &Composition {
        &self.stages.composition
    }

    /// Returns an error if `choice` forces the flavour `vt` and the scene has no virtual texture.
    fn check_variant(&self, choice: VariantChoice) -> Result<()> {
        let (VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant)) = choice else { return Ok(()) };
        if variant.has(Flavour::VirtualTexture) && !self.demands.has(Flavour::VirtualTexture) {
            return Err(Error::Request(format!(
                "scene `{}` has no virtual texture, so `{variant}` cannot be forced: set flavours.far_atlas_m above 0, or leave out vt",
                self.scene.name
            )));
        }
        Ok(())
    }

    /// Selects the nodes for the view `eye` and makes them resident.
    fn select(&mut self, request: &RenderRequest, eye: &View) -> Result<Selected> {
        let selection = self.select_nodes(request, eye)?;
        let slots = selection.visited.iter().filter_map(|&n| Some((n, self.streaming.get(n)?.0)));
        self.terrain.update(&self.gpu, slots);
        let GeometryRequest { vertex_stride, error_px, .. } = request.geometry;
        let nodes = self.nodes_of(&selection.drawn);
        let levels = Levels::of(&nodes, self.world.layout(), eye, vertex_stride.ilog2() as u8, error_px);
        Ok(Selected { lag: quadtree::lag(&selection), visited: selection.visited, drawn: selection.drawn, levels })
    }

    /// Those of `nodes` that are resident, each with its slot, its bounds and the bounds of its patches.
    fn nodes_of(&self, nodes: &[NodeId]) -> Vec<DrawnNode<'_>> {
        let resident = |&node: &NodeId| {
            let (slot, bounds) = self.streaming.get(node)?;
            Some(DrawnNode { node, slot, bounds, patches: self.streaming.patches(node) })
        };
        nodes.iter().filter_map(resident).collect()
    }

    /// The patches of selected nodes that may be visible from `eye`, in the local coordinates of `view`.
    fn visible_patches(&self, request: &RenderRequest, selected: &Selected, [view, eye]: [&View; 2]) -> Culled {
        let conditions = Conditions {
            layout: self.world.layout(),
            levels: &selected.levels,
            rounding_m: self.world.elevation_rounding_m(),
            culls: request.geometry.culls,
        };
        culling::cull(&self.nodes_of(&selected.drawn), [view, eye], conditions)
    }

    /// Elevation of the ground at the world position (`x`, `y`), metres, with the nodes, vertex strides and stitching of the request. Culling is
    /// ignored. In contrast, [`Renderer::ground_m`] always uses all vertices of the finest LOD. `None` = there is no ground at this position, because
    /// it is outside the data or a hole removes the triangle. Nodes that are not resident are loaded. The geometry of the last frame cannot be reused
    /// after this call.
    ///
    /// # Errors
    /// When [`RenderRequest::check`] refuses the request, its residency belongs to an earlier frame of simulated streaming ([`Renderer::arrive`]),
    /// the view needs more nodes than fit in the atlases, or the device fails.
    pub fn drawn_ground_m(&mut self, request: &RenderRequest, x: f64, y: f64) -> Result<Option<f64>> {
        request.check(&self.gpu.device.limits(), self.options.tile)?;
        // The selection may replace nodes that the last frame used, so the geometry of that frame cannot be reused.
        self.drawn = None;
        let eye = self.eye(request);
        let Selected { drawn, levels, .. } = self.select(request, &eye)?;
        Ok(Surface { world: &self.world, drawn: &drawn, levels: &levels }.height_m(x, y))
    }

    /// The view from which the request selects nodes and culls patches.
    fn eye(&self, request: &RenderRequest) -> View {
        request.geometry.culled_from.map_or_else(|| self.view(request), |pose| self.view(&request.with(|r| r.view.pose = pose)))
    }

    /// Builds the shading pipelines that a request needs and that do not exist yet. Returns the keys of all pipelines that the request needs.
    /// `tiles`: the number of tiles in each list, first in the list of the generic kernel, then in those of the 31 variants.
    ///
    /// # Errors
    /// When a pipeline cannot be built.
    fn warm(&mut self, request: &RenderRequest, tiles: &[u32]) -> Result<Vec<PipelineKey>> {
        let has_tiles = |mask: usize| tiles.get(mask).is_some_and(|&n| n > 0);
        let kernels: Vec<Kernel> = match request.shading.variant {
            VariantChoice::Auto | VariantChoice::Forced(_) => {
                Variant::all().filter(|v| has_tiles(usize::from(v.mask()))).map(Kernel::Variant).collect()
            }
            VariantChoice::GenericAuto | VariantChoice::GenericForced(_) => vec![Kernel::Generic],
        };
        let keys: Vec<PipelineKey> = kernels
            .into_iter()
            .map(|kernel| PipelineKey {
                kernel,
                estimator: request.shading.estimator,
                noise: request.shading.noise,
                two_tilings: request.shading.two_tilings,
                diagnostics: request.wants_diagnostics(),
            })
            .map(PipelineKey::canonical)
            .collect();
        let total = keys.len() as u64;
        for (done, &key) in (0..).zip(&keys) {
            if self.stages.shading.warm(&self.gpu, key)? {
                (self.progress)(Progress { stage: "shader variants".to_owned(), done, total });
            }
        }
        // The pipelines of the displayed view are recorded, so that a reload of the shaders can build them at once. A frame without lighting is not
        // displayed, so its pipelines are not recorded.
        if request.outputs.lit {
            self.stages.shading.display(&keys, !request.outputs.keep_geometry);
        }
        Ok(keys)
    }
}

/// Returns the demands of a scene. The anisotropy is 1 if the device compiles anisotropic shaders too slowly ([`Gpu::without_anisotropy`]).
fn demands_on(gpu: &Gpu, scene: &Scene) -> Demands {
    let demands = Demands::of(scene);
    Demands { anisotropy: gpu.anisotropy(demands.anisotropy), ..demands }
}

/// Returns an error if the scene applies cliff shading only above a slope that the world does not reach.
fn check_cliffs(scene: &Scene, world: &World) -> Result<()> {
    // The search of `is_as_steep_as` comes first, because it usually ends early. Computing the largest slope can take a tenth of a second.
    let asked = scene.flavours.cliff_slope_deg;
    if !scene.flavours.has_cliffs() || world.is_as_steep_as(asked) {
        Ok(())
    } else {
        scene::validate_against_world(scene, world.max_slope_deg())
    }
}
