//! Explicit bind-group layouts: lists with one [`Binding`] for each binding. Layouts are not derived from shaders, because a derived layout could
//! lack textures that only dead branches use.

use crate::gpu::{Gpu, Shader};

/// The type of a binding.
#[derive(Clone, Copy)]
pub enum Binding {
    /// A uniform buffer.
    Uniform,
    /// A read-only storage buffer.
    Storage,
    /// A storage buffer that shaders write.
    StorageWritten,
    /// A filterable float texture.
    Texture(wgpu::TextureViewDimension),
    /// A float texture that is only read by `textureLoad`, without a sampler.
    TextureLoaded(wgpu::TextureViewDimension),
    /// A texture of unsigned integers.
    TextureUint(wgpu::TextureViewDimension),
    /// A depth texture.
    Depth,
    /// A filtering sampler.
    Sampler,
}

/// Shorthand for a two-dimensional texture.
pub const FLAT: wgpu::TextureViewDimension = wgpu::TextureViewDimension::D2;
/// Shorthand for an array of two-dimensional textures.
pub const ARRAY: wgpu::TextureViewDimension = wgpu::TextureViewDimension::D2Array;

impl Binding {
    fn kind(self) -> wgpu::BindingType {
        let texture = |sample_type, view_dimension| wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false };
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        match self {
            Binding::Uniform => buffer(wgpu::BufferBindingType::Uniform),
            Binding::Storage => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Binding::StorageWritten => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Binding::Texture(d) => texture(wgpu::TextureSampleType::Float { filterable: true }, d),
            Binding::TextureLoaded(d) => texture(wgpu::TextureSampleType::Float { filterable: false }, d),
            Binding::TextureUint(d) => texture(wgpu::TextureSampleType::Uint, d),
            Binding::Depth => texture(wgpu::TextureSampleType::Depth, FLAT),
            Binding::Sampler => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        }
    }
}

impl Gpu {
    /// A bind-group layout with `bindings` in order, the first at index 0.
    pub fn layout(&self, label: &str, stages: wgpu::ShaderStages, bindings: &[Binding]) -> wgpu::BindGroupLayout {
        let entries: Vec<_> = (0..)
            .zip(bindings)
            .map(|(binding, b)| wgpu::BindGroupLayoutEntry { binding, visibility: stages, ty: b.kind(), count: None })
            .collect();
        self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
    }

    /// A bind group with `resources` in order, the first at index 0.
    pub fn group(&self, label: &str, layout: &wgpu::BindGroupLayout, resources: &[wgpu::BindingResource<'_>]) -> wgpu::BindGroup {
        let entries: Vec<_> =
            (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() }).collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries })
    }

    /// A pipeline layout with `groups` in order, the first at index 0.
    pub fn pipeline_layout(&self, label: &str, groups: &[&wgpu::BindGroupLayout]) -> wgpu::PipelineLayout {
        let groups: Vec<_> = groups.iter().map(|g| Some(*g)).collect();
        self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        })
    }

    /// A pipeline that draws one full-screen triangle into a target of `format`. Its entry points are `LABEL_vertex` and `LABEL_fragment`, where
    /// `LABEL` is the value of `label`.
    pub fn full_screen(
        &self,
        label: &str,
        shader: &Shader,
        groups: &[&wgpu::BindGroupLayout],
        format: wgpu::TextureFormat,
    ) -> wgpu::RenderPipeline {
        let [vertex, fragment] = ["vertex", "fragment"].map(|stage| format!("{label}_{stage}"));
        self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: Some(&self.pipeline_layout(label, groups)),
            vertex: wgpu::VertexState {
                module: &shader.module,
                entry_point: Some(&vertex),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader.module,
                entry_point: Some(&fragment),
                compilation_options: Default::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    /// A two-dimensional texture that one pass renders to and other passes read.
    pub fn target(&self, label: &str, size: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }
}

/// A view of the whole texture.
pub fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A view of one aspect (depth or stencil) of a texture.
pub fn aspect(texture: &wgpu::Texture, aspect: wgpu::TextureAspect) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor { aspect, ..Default::default() })
}

/// A view of all layers of an array texture, even if it has only one layer.
pub fn array(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor { dimension: Some(ARRAY), ..Default::default() })
}
