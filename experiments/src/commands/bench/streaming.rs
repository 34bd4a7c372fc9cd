//! The streamed flight of `bench`: how much coarser than wanted the terrain is drawn when nodes arrive late.

use anyhow::Result;
use kernels::frame::{RenderRequest, Renderer};
use kernels::quadtree::{Lag, Selection, lag};
use kernels::residency::{Arrivals, Schedule};
use kernels::world::{NodeId, SECTORS};
use serde::Serialize;

use super::flight;
use crate::cli::BenchArgs;
use crate::process::check_interrupted;

/// Speed of the camera, metres per second.
const SPEED: f64 = 100.0;
/// Frame rate of the flight.
const FRAMES_PER_SECOND: f64 = 30.0;
/// The flight is divided into this many equal parts, each of 1 km. The lag ([`Lag`]) is given for each part.
const PARTS: usize = 10;
/// The simulated schedules: first the defaults of the settings `frame.nodes_per_frame` and `frame.latency`. The payload of a node has 72 419 bytes,
/// so at 30 frames per second, 8 nodes per frame are at most 17.4 MB/s, and 1 node per frame is at most 2.2 MB/s.
const SCHEDULES: [Schedule; 2] = [Schedule { nodes_per_frame: 8, latency_frames: 8 }, Schedule { nodes_per_frame: 1, latency_frames: 30 }];
/// Largest number of frames that are simulated after a teleport. A view needs at most 512 nodes, so even the slower schedule should need fewer
/// frames.
const LONGEST: u32 = 1000;

/// The lag over the frames of one part of the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Part {
    /// Mean share of the ground that is drawn coarser than wanted, 0..=1.
    share: f64,
    /// Mean number of levels by which this ground is coarser; 0 if no ground is.
    levels: f64,
    /// Largest number of levels by which the ground is coarser anywhere.
    largest: u8,
}

/// The flight with one schedule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Streamed {
    nodes_per_frame: u32,
    latency_frames: u32,
    /// Number of frames of the flight and after the teleport.
    frames: u32,
    /// Number of these frames in which a sector of the ground is not drawn, or is drawn more than once.
    broken: u32,
    /// The lag in each kilometre of the flight.
    lag: Vec<Part>,
    /// The share of the ground that is drawn coarser than wanted in the first frame after a teleport from the end of the flight to its start.
    teleport_share: f64,
    /// Number of frames after the first one of the teleport until all wanted nodes are drawn; at most `LONGEST`.
    teleport_frames: u32,
}

/// Whether the nodes cover each sector exactly once.
fn is_whole(drawn: &[NodeId]) -> bool {
    let side = usize::from(SECTORS);
    let mut covers = vec![0u8; side * side];
    for node in drawn {
        let edge = 1usize << node.lod;
        for row in 0..edge {
            let first = (usize::from(node.y) * edge + row) * side + usize::from(node.x) * edge;
            covers[first..first + edge].iter_mut().for_each(|count| *count = count.saturating_add(1));
        }
    }
    covers.iter().all(|&count| count == 1)
}

impl Streamed {
    /// Flies once for each schedule. Nothing is drawn: only the nodes of each frame are selected.
    pub(super) fn all(renderer: &mut Renderer<'_>, args: &BenchArgs, step: &dyn Fn(u64, u64)) -> Result<Vec<Streamed>> {
        let frames = (flight::LENGTH_M / SPEED * FRAMES_PER_SECOND) as u32;
        let total = u64::from(frames) * SCHEDULES.len() as u64;
        let each = (0..).zip(SCHEDULES).map(|(index, schedule)| {
            let step = |frame: u32| step(index * u64::from(frames) + u64::from(frame), total);
            Streamed::fly(renderer, args, schedule, frames, &step)
        });
        each.collect()
    }

    fn fly(renderer: &mut Renderer<'_>, args: &BenchArgs, schedule: Schedule, frames: u32, step: &dyn Fn(u32)) -> Result<Streamed> {
        let request = |renderer: &Renderer<'_>, t: f64| RenderRequest::new(flight::pose(t, |x, y| renderer.ground_m(x, y)), args.size);
        let start = request(renderer, 0.0);
        let mut arrivals = renderer.arrivals(schedule, &start)?;
        let mut broken = 0;
        let mut frame = |renderer: &mut Renderer<'_>, arrivals: &mut Arrivals, request: &RenderRequest| -> Result<(Lag, Selection)> {
            check_interrupted()?;
            let (_, selection) = renderer.arrive(arrivals, request)?;
            broken += u32::from(!is_whole(&selection.drawn));
            Ok((lag(&selection), selection))
        };
        let mut parts = vec![Vec::new(); PARTS];
        for number in 0..frames {
            step(number);
            let t = f64::from(number) / f64::from(frames);
            let request = request(renderer, t);
            parts[(t * PARTS as f64) as usize].push(frame(renderer, &mut arrivals, &request)?.0);
        }
        let (first, _) = frame(renderer, &mut arrivals, &start)?;
        let mut teleport_frames = 0;
        while teleport_frames < LONGEST {
            teleport_frames += 1;
            if frame(renderer, &mut arrivals, &start)?.1.wanted.is_empty() {
                break;
            }
        }
        Ok(Streamed {
            nodes_per_frame: schedule.nodes_per_frame,
            latency_frames: schedule.latency_frames,
            frames: frames + 1 + teleport_frames,
            broken,
            lag: parts.iter().map(|part| Part::of(part)).collect(),
            teleport_share: first.share,
            teleport_frames,
        })
    }

    /// The flight as text.
    pub(super) fn text(&self) -> String {
        let share = |part: &Part| format!("{:.1}", 100.0 * part.share);
        let levels = |part: &Part| format!("{:.1}", part.levels);
        let list = |number: &dyn Fn(&Part) -> String| self.lag.iter().map(number).collect::<Vec<_>>().join(" ");
        format!(
            "streamed flight of 10 km at {SPEED} m/s, {FRAMES_PER_SECOND} frames/s, {} nodes per frame, latency {} frames\n  \
             frames with a gap or an overlap: {} of {}\n  ground drawn coarser than wanted, % for each km: {}\n    by how many levels: {}\n  \
             after a teleport: {:.0} % in the first frame, none after {} frames\n",
            self.nodes_per_frame,
            self.latency_frames,
            self.broken,
            self.frames,
            list(&share),
            list(&levels),
            100.0 * self.teleport_share,
            self.teleport_frames,
        )
    }
}

impl Part {
    fn of(lags: &[Lag]) -> Part {
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
            sum / f64::from(count.max(1))
        };
        Part {
            share: mean(&mut lags.iter().map(|lag| lag.share)),
            levels: mean(&mut lags.iter().filter(|lag| lag.share > 0.0).map(|lag| lag.levels)),
            largest: lags.iter().map(|lag| lag.largest).max().unwrap_or(0),
        }
    }
}
