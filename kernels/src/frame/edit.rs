//! Changes a scene while it is drawn. Only the parts that the change affects are rebuilt.

use std::sync::Arc;

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::frame::Renderer;
use crate::materials::Palette;
use crate::residency::Changes;
use crate::scene;
use crate::scene::demands::Demands;
use crate::scene::{Blend, Scene};
use crate::terrain::palette_means;
use crate::variant::Flavour;

/// Counts of the nodes and texture layers that were rebuilt because of edits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EditCounts {
    /// Number of resident nodes whose splat map changed, or that have a material whose mean albedo, smoothness or specular occlusion changed.
    pub nodes: usize,
    /// Number of layers of detail textures that changed.
    pub textures: usize,
}

/// Returns a function that reports which texture is being made.
pub(super) fn on_texture(progress: &(dyn Fn(Progress) + Sync)) -> impl Fn(&str) -> Result<()> + Sync {
    move |name| {
        progress(Progress { stage: name.to_owned(), done: 0, total: 0 });
        Ok(())
    }
}

impl Renderer<'_> {
    /// Replaces the scene without building a new renderer. Returns whether the renderer now has the given scene; if not, nothing has changed.
    ///
    /// The new scene must require the same flavours (shading techniques) as the current one. It may differ in name, description, light, the rules of
    /// the flavours, cameras, paths, and all parameters of the blend except anisotropy and material contrast. For an
    /// [`editable`](crate::frame::RendererOptions::editable) renderer, it may also differ in materials, material contrast, splat rules and strokes.
    /// Only the nodes, textures and pages that the change affects are rebuilt.
    ///
    /// # Errors
    /// When the scene is invalid, its cliffs begin at a slope that the world does not reach, or a texture cannot be loaded. In these cases, nothing
    /// has changed.
    pub fn retune(&mut self, scene: &Scene) -> Result<bool> {
        if *scene == self.scene {
            return Ok(true);
        }
        let demands = super::demands_on(&self.gpu, scene);
        let has = |d: &Demands| Flavour::ALL.map(|f| d.has(f));
        if !self.can_take(scene) || has(&demands) != has(&self.demands) {
            return Ok(false);
        }
        scene::validate(scene)?;
        super::check_cliffs(scene, &self.world)?;
        let palette = match &self.palette {
            Some(before) if self.needs_textures(scene) => {
                Some(before.rebuilt(scene, self.former.as_ref(), self.world.layout().sector_m, on_texture(self.progress))?)
            }
            _ => None,
        };

        // Nothing can fail from here on, so the renderer changes completely or not at all.
        let names = |s: &Scene| s.materials.iter().map(|m| m.name.clone()).collect::<Vec<_>>();
        let laid = |s: &Scene| (s.rules.clone(), s.strokes.clone(), names(s));
        let relaid = laid(scene) != laid(&self.scene);
        if relaid {
            self.world = Arc::new(self.world.laid_by(scene));
        }
        if relaid || palette.is_some() {
            self.replace_materials(relaid, palette);
        }
        // Only two numbers of the blend affect cached pages. The sharpness of the height blend changes their texels. The mip bias changes only the
        // rounding of their texels, because the shader that renders pages cancels the bias.
        let enters = |blend: &Blend| [blend.height_sharpness, blend.mip_bias];
        if enters(&scene.blend) != enters(&self.scene.blend) {
            self.stages.virtual_texture.forget();
        }
        // The geometry pass writes the mask of the flavours that each pixel needs, so it must run again.
        if scene.flavours != self.scene.flavours {
            self.drawn = None;
        }
        self.scene = scene.clone();
        self.demands = demands;
        Ok(true)
    }

    /// Whether an editable renderer must build a new palette to take this scene ([`Renderer::retune`]). If no texture can be reused, building the
    /// palette takes as long as making all textures of the scene.
    pub fn needs_textures(&self, scene: &Scene) -> bool {
        let textured = |s: &Scene| (s.materials.clone(), s.blend.material_contrast.to_bits(), s.folder.clone());
        textured(scene) != textured(&self.scene)
    }

    /// Ends the quick preview ([`sketch`](crate::frame::RendererOptions::sketch)): replaces its small detail textures with those of `palette`, which
    /// have the size that the scene gives.
    pub fn take_palette(&mut self, palette: Palette) {
        self.replace_materials(false, Some(palette));
    }

    /// Whether the detail textures are still the small ones of a quick preview ([`sketch`](crate::frame::RendererOptions::sketch)). False if the
    /// renderer is not editable.
    pub fn is_sketch(&self) -> bool {
        self.palette.as_ref().is_some_and(|palette| palette.arrays.size != self.scene.detail_size)
    }

    /// Whether the new scene differs from the current one only in what this renderer can change.
    fn can_take(&self, scene: &Scene) -> bool {
        let own = &self.scene;
        let blend = Blend { anisotropy: scene.blend.anisotropy, material_contrast: scene.blend.material_contrast, ..own.blend.clone() };
        let mut same = Scene {
            name: own.name.clone(),
            description: own.description.clone(),
            flavours: own.flavours.clone(),
            blend,
            sun: own.sun.clone(),
            sky: own.sky.clone(),
            cameras: own.cameras.clone(),
            paths: own.paths.clone(),
            ..scene.clone()
        };
        if self.palette.is_some() {
            same.materials.clone_from(&own.materials);
            same.rules.clone_from(&own.rules);
            same.strokes.clone_from(&own.strokes);
            same.blend.material_contrast = own.blend.material_contrast;
        }
        same == *own
    }

    /// Replaces the palette, if a new one is given, and bakes the affected nodes again. `relaid`: whether materials now lie at other places of the
    /// world.
    fn replace_materials(&mut self, relaid: bool, palette: Option<Palette>) {
        let mut means = Vec::new();
        let mut looks = Vec::new();
        if let Some(palette) = palette {
            let before = self.palette.as_ref();
            let fresh = before.and_then(|before| palette.fresh_layers(before));
            let is_fresh = |layer: u32| fresh.as_ref().is_none_or(|fresh| fresh.contains(&(layer as usize)));
            for (index, entry) in palette.entries.iter().enumerate() {
                means.push(before.and_then(|before| before.means.get(index)) != palette.means.get(index));
                looks.push(before.and_then(|before| before.entries.get(index)) != Some(entry) || is_fresh(entry.albedo_layer));
            }
            self.terrain.replace_palette(&self.gpu, &self.streaming, &palette, fresh.as_deref());
            self.edited.textures += fresh.map_or(palette.arrays.albedo.len(), |fresh| fresh.len());
            self.means = palette_means(&palette);
            self.former = self.palette.replace(palette);
        } else {
            means.resize(self.means.albedo.len(), false);
            looks.clone_from(&means);
        }
        let nodes = self.streaming.lay_anew(&self.gpu, &self.world, &self.means, &Changes { relaid, means, looks });
        self.edited.nodes += nodes;
        if nodes > 0 {
            // The geometry pass must run again, because it reads the normal atlas. The compressed blocks of this atlas store smoothness and specular
            // occlusion together with the y of the normal. So a change of the materials can also change the decoded normals slightly.
            self.drawn = None;
        }
    }
}
