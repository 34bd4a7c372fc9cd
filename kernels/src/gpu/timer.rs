//! Time per pass, from timestamp queries at the beginning and the end of each pass.

use crate::base::error::{Error, Result};
use crate::gpu::{Gpu, read_buffer};

/// The time of one pass.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// The pass's name.
    pub name: String,
    /// Time on the device, milliseconds.
    pub time_ms: f64,
}

/// Collects the times of the passes of one frame. On a device without timestamps, it collects nothing.
pub struct Timer {
    queries: Option<wgpu::QuerySet>,
    resolved: wgpu::Buffer,
    names: Vec<String>,
    /// Number of passes that were not timed, because the timer was full.
    missed: u32,
    period_ns: f64,
}

impl Timer {
    /// Largest number of passes that one timer can measure.
    pub const CAPACITY: u32 = 64;

    /// An empty timer.
    pub fn new(gpu: &Gpu) -> Timer {
        let queries = gpu.features.contains(wgpu::Features::TIMESTAMP_QUERY).then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: Timer::CAPACITY * 2,
            })
        });
        let resolved =
            gpu.buffer("pass times", wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC, u64::from(Timer::CAPACITY * 2) * 8);
        Timer { queries, resolved, names: Vec::new(), missed: 0, period_ns: f64::from(gpu.queue.get_timestamp_period()) }
    }

    fn next(&mut self, name: &str) -> Option<(u32, u32)> {
        self.queries.as_ref()?;
        let Some(index) = u32::try_from(self.names.len()).ok().filter(|&i| i < Timer::CAPACITY) else {
            self.missed += 1;
            return None;
        };
        self.names.push(name.to_owned());
        Some((index * 2, index * 2 + 1))
    }

    /// Timestamp writes for a render pass; `None` if the device has no timestamps, or the timer is full.
    pub fn render(&mut self, name: &str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (begin, end) = self.next(name)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set: self.queries.as_ref()?,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(end),
        })
    }

    /// Timestamp writes for a compute pass; `None` as for [`Timer::render`].
    pub fn compute(&mut self, name: &str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let (begin, end) = self.next(name)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: self.queries.as_ref()?,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(end),
        })
    }

    /// Records the resolve of the queries; call it once, after the last pass.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let count = u32::try_from(self.names.len()).unwrap_or(0) * 2;
        if let (Some(queries), true) = (&self.queries, count > 0) {
            encoder.resolve_query_set(queries, 0..count, &self.resolved, 0);
        }
    }

    /// The times, in the order of the passes; call it after the commands were submitted. The times of passes of the same name are added.
    ///
    /// # Errors
    /// When the device is lost or reported an error, or when there were more passes than the timer holds. The times of the passes that fit are not
    /// returned then, because callers could not see that the list is incomplete.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<PassTime>> {
        if self.names.is_empty() {
            return Ok(Vec::new());
        }
        if self.missed > 0 {
            return Err(Error::Gpu(format!(
                "{} of {} passes were not timed: a timer holds {} passes; time fewer passes per frame",
                self.missed,
                self.missed + Timer::CAPACITY,
                Timer::CAPACITY
            )));
        }
        let bytes = read_buffer(gpu, &self.resolved, self.names.len() as u64 * 16)?;
        let stamps: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
        let ms = stamps.chunks_exact(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64 * self.period_ns * 1e-6);
        Ok(summed(self.names.iter().zip(ms)))
    }
}

/// Adds the times of passes of the same name. The order is that of the first pass of each name.
fn summed<'a>(passes: impl Iterator<Item = (&'a String, f64)>) -> Vec<PassTime> {
    let mut times: Vec<PassTime> = Vec::new();
    for (name, time_ms) in passes {
        match times.iter_mut().find(|time| time.name == *name) {
            Some(time) => time.time_ms += time_ms,
            None => times.push(PassTime { name: name.clone(), time_ms }),
        }
    }
    times
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_of_one_name_have_one_time() {
        let names = ["geometry", "occlusion", "geometry", "lighting"].map(str::to_owned);
        let times = summed(names.iter().zip([1.0, 2.0, 4.0, 8.0]));
        let times: Vec<(&str, f64)> = times.iter().map(|time| (time.name.as_str(), time.time_ms)).collect();
        assert_eq!(times, [("geometry", 5.0), ("occlusion", 2.0), ("lighting", 8.0)]);
    }
}
