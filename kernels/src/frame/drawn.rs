//! A drawn frame, and what can be read or computed from it.

use std::ops::Deref;

use crate::base::error::{Error, Result};
use crate::composition::{Destination, Layers};
use crate::frame::picture::Picture;
use crate::frame::{FrameReport, RenderRequest, Renderer, Targets};
use crate::geometry;
use crate::gpu::{PassTime, Recording};
use crate::inspect::Inspected;
use crate::metrics::{FrameSums, Meter};
use crate::motion::Links;
use crate::variant::Variant;
use crate::view::camera::View;

/// A drawn frame on the device, with the request that made it. A `Frame` borrows the renderer, so that nothing
/// else can be drawn while the frame is in use.
///
/// Operations that need only the geometry are methods of [`DrawnGeometry`].
pub struct Frame<'f, 'a> {
    geometry: DrawnGeometry<'f, 'a>,
    report: FrameReport,
}

impl<'f, 'a> Deref for Frame<'f, 'a> {
    type Target = DrawnGeometry<'f, 'a>;

    fn deref(&self) -> &Self::Target {
        &self.geometry
    }
}

impl<'f, 'a> Frame<'f, 'a> {
    pub(super) fn new(renderer: &'f Renderer<'a>, targets: &'f Targets, request: RenderRequest, report: FrameReport) -> Frame<'f, 'a> {
        Frame { geometry: DrawnGeometry::new(renderer, targets, request), report }
    }

    /// The report of the frame.
    pub fn report(&self) -> &FrameReport {
        &self.report
    }

    /// The render targets of the frame, for tests and inspection.
    pub fn targets(&self) -> &'f Targets {
        self.targets
    }

    /// Consumes the frame and returns its report.
    pub fn into_report(self) -> FrameReport {
        self.report
    }

    /// Reads back the requested picture and layers.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read(self) -> Result<Picture> {
        Picture::read(self)
    }
}

/// The geometry of a view on the device: depth, normals and classification mask. It gives no access to pictures, because the shading in the targets
/// may belong to a different request.
pub struct DrawnGeometry<'f, 'a> {
    renderer: &'f Renderer<'a>,
    targets: &'f Targets,
    request: RenderRequest,
    view: View,
}

impl<'f, 'a> DrawnGeometry<'f, 'a> {
    pub(super) fn new(renderer: &'f Renderer<'a>, targets: &'f Targets, request: RenderRequest) -> DrawnGeometry<'f, 'a> {
        DrawnGeometry { view: renderer.view(&request), renderer, targets, request }
    }

    /// The request to which this geometry belongs.
    pub fn request(&self) -> &RenderRequest {
        &self.request
    }

    /// The view that the geometry shows.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// The renderer that drew the geometry.
    pub fn renderer(&self) -> &'f Renderer<'a> {
        self.renderer
    }

    /// The targets of the geometry pass.
    pub fn geometry_targets(&self) -> &'f geometry::Targets {
        &self.targets.geometry
    }

    /// Returns, for each pixel, the index of the pixel of the previous frame that showed the same surface point. The previous frame is that of the
    /// previous call with these `links`. [`NO_LINK`](crate::motion::NO_LINK) = the pixel shows no terrain, the point was not visible in the previous
    /// frame, or there was no previous call.
    ///
    /// # Errors
    /// When `links` are for pictures of a different size or the device fails.
    pub fn link(&self, links: &mut Links) -> Result<Vec<u32>> {
        let (own, other) = (self.request.view.size, links.size());
        if own != other {
            return Err(Error::Request(format!(
                "links for pictures of {}x{} pixels do not fit this picture of {}x{}: make links of the size of the picture",
                other[0], other[1], own[0], own[1]
            )));
        }
        links.find(&self.renderer.gpu, &self.uniforms(), &self.targets.geometry, self.view)
    }

    /// Composes pictures from the layers of the flavours, and writes each picture to its destination.
    ///
    /// # Errors
    /// When the device fails.
    pub fn compose(&self, layers: &Layers, destinations: &[Destination<'_>]) -> Result<()> {
        let uniforms = self.uniforms();
        let groups = [&uniforms];
        let mut rec = Recording::new(&self.renderer.gpu, &groups);
        self.renderer.stages.composition.encode(&mut rec, &self.targets.geometry, layers, self.request.stages.display, destinations);
        rec.submit()
    }

    /// Measures this frame for each stream (sequence of pictures) of `meter`. The picture of a stream is composed from `layers`. It is compared with
    /// the stream's pictures of earlier frames and, if the meter has a reference sequence, with the pictures of that sequence. `variants` gives the
    /// variant of each stream; `None` = each pixel has the flavours that it needs. Returns the sums of each stream, and the device times of the
    /// passes.
    ///
    /// # Errors
    /// When the device fails.
    pub fn measure(&self, layers: &Layers, meter: &mut Meter, variants: &[Option<Variant>]) -> Result<(Vec<FrameSums>, Vec<PassTime>)> {
        let (gpu, composition) = (&self.renderer.gpu, &self.renderer.stages.composition);
        let uniforms = self.uniforms();
        let groups = [&uniforms];
        let mut rec = Recording::new(gpu, &groups);
        let slots = meter.slots();
        meter.motion.encode(&mut rec, &self.targets.geometry, &self.view, &slots);
        let destinations: Vec<_> = variants
            .iter()
            .zip(&meter.streams)
            .map(|(&v, s)| Destination { stream: composition.stream(v).of(s.track.signal), signal: &s.signal, offset: slots.now })
            .collect();
        composition.encode(&mut rec, &self.targets.geometry, layers, self.request.stages.display, &destinations);
        meter.encode(gpu, &mut rec.encoder, &mut rec.timer);
        let passes = rec.finish()?;
        let sums = meter.read(gpu)?;
        meter.motion.advance(self.view);
        Ok((sums, passes))
    }

    /// Returns position, derivatives and splat texels of each pixel, row by row from the top.
    ///
    /// # Errors
    /// When the device fails.
    pub fn inspect(&self) -> Result<Vec<Inspected>> {
        let groups = [&self.uniforms(), &self.renderer.terrain.group];
        self.renderer.stages.inspect.run(&self.renderer.gpu, groups, &self.targets.geometry)
    }

    fn uniforms(&self) -> wgpu::BindGroup {
        self.renderer.frame_group(&self.request)
    }
}
