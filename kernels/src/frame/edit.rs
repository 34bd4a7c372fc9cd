//! A scene that changes while it is drawn: what the change touches is made anew, and nothing else.

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

/// What edits had made anew.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EditCounts {
    /// Nodes on which other materials lie, or one whose mean look changed.
    pub nodes: usize,
    /// Layers of detail textures.
    pub textures: usize,
}

/// Tells which texture is being made.
pub(super) fn on_texture(progress: &(dyn Fn(Progress) + Sync)) -> impl Fn(&str) -> Result<()> + Sync {
    move |name| {
        progress(Progress { stage: name.to_owned(), done: 0, total: 0 });
        Ok(())
    }
}

impl Renderer<'_> {
    /// Takes another scene over, if it differs from the one drawn only in what can change while it is drawn: the light, the flavours' distances and
    /// slopes, the blend (but for anisotropy), cameras and paths; and, in a renderer that is
    /// [`editable`](crate::frame::RendererOptions::editable), materials, splat rules and strokes. Of nodes, textures and pages those are made anew that
    /// the change touches. Says whether it could; if not, nothing was changed.
    ///
    /// # Errors
    /// When the scene is wrong, asks for cliffs that the world does not have, or a texture cannot be had. Then nothing was changed.
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

        // From here on nothing can go wrong.
        let names = |s: &Scene| s.materials.iter().map(|m| m.name.clone()).collect::<Vec<_>>();
        let laid = |s: &Scene| (s.rules.clone(), s.strokes.clone(), names(s));
        let relaid = laid(scene) != laid(&self.scene);
        if relaid {
            self.world = Arc::new(self.world.laid_by(scene));
        }
        if relaid || palette.is_some() {
            self.replace_materials(relaid, palette);
        }
        // Of these numbers the height blend enters the texels of pages; a mip bias only rounds them otherwise.
        let enters = |blend: &Blend| [blend.height_sharpness, blend.mip_bias];
        if enters(&scene.blend) != enters(&self.scene.blend) {
            self.stages.virtual_texture.forget();
        }
        // What the geometry pass writes: the flavours that pixels need.
        if scene.flavours != self.scene.flavours {
            self.drawn = None;
        }
        self.scene = scene.clone();
        self.demands = demands;
        Ok(true)
    }

    /// Whether [`Renderer::retune`] to this scene makes a palette anew, which may take as long as its textures take to make.
    pub fn needs_textures(&self, scene: &Scene) -> bool {
        let textured = |s: &Scene| (s.materials.clone(), s.blend.material_contrast.to_bits(), s.folder.clone());
        textured(scene) != textured(&self.scene)
    }

    /// Draws with the scene's own textures from now on, after a [`sketch`](crate::frame::RendererOptions::sketch).
    pub fn take_palette(&mut self, palette: Palette) {
        self.replace_materials(false, Some(palette));
    }

    /// Whether the textures are those that the scene asks for.
    pub fn is_sketch(&self) -> bool {
        self.palette.as_ref().is_some_and(|palette| palette.arrays.size != self.scene.detail_size)
    }

    /// Whether the two scenes differ in nothing that this renderer was made for.
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

    /// Lays materials by the world's rules if those are others than before (`relaid`), and shows them by another palette if there is one.
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
            // Normals, which the geometry pass writes, share their texels with what materials are like.
            self.drawn = None;
        }
    }
}
