//! Tests the selection of nodes when some have not arrived, and simulated streaming, without a device.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use glam::DVec3;
use kernels::quadtree::{self, Lag, NodeBounds, Selection, Wanted, lag, lod_map};
use kernels::residency::{Arrivals, CAPACITY, Schedule};
use kernels::scene;
use kernels::view::camera::{Pose, View};
use kernels::world::{NodeId, World};

use crate::statistics::Random;

fn built_in_world() -> World {
    let scene = scene::parse(scene::DEFAULT_TEXT, "default", Path::new(".")).expect("the built-in scene is valid");
    World::new(&scene).expect("a procedural world needs no files")
}

/// A view from a position, with the largest split ratio.
fn view_at([x, y]: [f64; 2], yaw: f64) -> View {
    View::new(Pose { position: DVec3::new(x, y, 400.0), yaw, pitch: -0.3, fov: 0.3 }, [300, 2000], [0.0; 2], 64.0, 10_240.0)
}

/// Selects from the nodes for which `is_available` returns true. All nodes have the same range of elevations.
fn select(world: &World, view: &View, is_available: impl Fn(NodeId) -> bool) -> Selection {
    let flat = |nodes: &[NodeId]| Ok::<_, String>(vec![NodeBounds { height_m: [300.0, 310.0] }; nodes.len()]);
    quadtree::select(world, view, 0.0, is_available, flat).expect("loads")
}

fn set(nodes: &[NodeId]) -> BTreeSet<NodeId> {
    nodes.iter().copied().collect()
}

/// Panics unless the nodes cover each of the 160 x 160 sectors exactly once.
fn assert_covers(drawn: &[NodeId]) {
    let mut covers = vec![0u8; 160 * 160];
    for node in drawn {
        let edge = 1 << node.lod;
        for row in 0..edge {
            for column in 0..edge {
                covers[(usize::from(node.y) * edge + row) * 160 + usize::from(node.x) * edge + column] += 1;
            }
        }
    }
    assert!(covers.iter().all(|&n| n == 1), "{} sectors are missing, {} overlap", count(&covers, |n| n == 0), count(&covers, |n| n > 1));
}

fn count(covers: &[u8], is_counted: impl Fn(u8) -> bool) -> usize {
    covers.iter().filter(|&&n| is_counted(n)).count()
}

#[test]
fn the_ground_is_covered_once_whatever_has_arrived() {
    let world = built_in_world();
    let mut random = Random(11);
    let (mut reached, mut partial) = (0, 0);
    for round in 0..2000u32 {
        let view = view_at([random.between(-5500.0, 5500.0), random.between(-5500.0, 5500.0)], random.between(0.0, 6.0));
        let settled = select(&world, &view, |_| true);
        // Three cases alternate. Case 0: each node has arrived with the probability `chance`. Case 1: only nodes of LOD `coarsest` and coarser have
        // arrived. Case 2: some whole subtrees have arrived.
        let (chance, salt, coarsest) = (random.between(0.5, 1.0), random.below(1 << 20), random.below(6) as u8);
        let is_available = |node: NodeId| match round % 3 {
            0 => Random(u64::from(node.lod) << 40 | u64::from(node.x) << 20 | u64::from(node.y) ^ salt as u64).between(0.0, 1.0) < chance,
            1 => node.lod >= coarsest,
            _ => (u64::from(node.x >> (5 - node.lod)) * 7 + u64::from(node.y >> (5 - node.lod)) * 3 + salt as u64).is_multiple_of(3),
        };
        let selection = select(&world, &view, is_available);
        assert_covers(&selection.drawn);
        let is_root = |node: &NodeId| node.lod == 5;
        assert!(selection.visited.iter().all(|node| is_root(node) || is_available(*node)), "a node was visited before it arrived");
        let [visited, all] = [set(&selection.visited), set(&settled.visited)];
        let wanted: BTreeSet<NodeId> = selection.wanted.iter().map(|wanted| wanted.node).collect();
        // Each node that would be visited if everything had arrived must be either visited or wanted. This holds because all nodes have the same
        // bounds here.
        assert!(wanted.is_disjoint(&visited) && wanted.len() == selection.wanted.len(), "each node is wanted once");
        assert_eq!(wanted.union(&visited).copied().collect::<BTreeSet<_>>(), all);
        assert!(selection.wanted.iter().all(|wanted| wanted.is_available == is_available(wanted.node)));
        for node in selection.drawn.iter().filter(|node| all.contains(node) && !settled.drawn.contains(node)) {
            assert!(node.children().iter().any(|child| !is_available(*child)), "{node:?} could be split");
            partial += 1;
        }
        // The expected lag is the difference of these two maps of LODs.
        let [drawn, ideal] = [&selection, &settled].map(|selection| lod_map(&selection.drawn));
        let behind: Vec<u8> = drawn.iter().zip(&ideal).map(|(drawn, ideal)| drawn - ideal).filter(|&n| n > 0).collect();
        let found = lag(&selection);
        let is_close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let mean = behind.iter().copied().map(f64::from).sum::<f64>() / behind.len().max(1) as f64;
        let largest = behind.iter().copied().max().unwrap_or(0);
        assert!(is_close(found.share, behind.len() as f64 / 25_600.0) && is_close(found.levels, mean) && found.largest == largest);
        reached += usize::from(largest >= 3);
    }
    assert!(reached > 100 && partial > 2000, "{reached} {partial}");
    assert_eq!(lag(&select(&world, &view_at([0.0; 2], 0.0), |_| true)), Lag::default());
}

/// A schedule that several tests use.
const SCHEDULE: Schedule = Schedule { nodes_per_frame: 6, latency_frames: 4 };

/// Simulates a frame: selects from the nodes that have arrived, and requests some of those that are missing.
fn frame(world: &World, arrivals: &mut Arrivals, view: &View) -> Selection {
    let arrived = arrivals.arrived().clone();
    let selection = select(world, view, |node| arrived.contains(&node));
    arrivals.step(&selection);
    selection
}

#[test]
fn streamed_nodes_arrive_on_schedule_and_the_picture_settles() {
    let world = built_in_world();
    let mut random = Random(13);
    for round in 0..6 {
        let start = view_at([0.0, 0.0], 0.0);
        let mut arrivals = Arrivals::new(SCHEDULE, select(&world, &start, |_| true).visited);
        assert_eq!(lag(&frame(&world, &mut arrivals, &start)), Lag::default(), "everything has arrived before the first frame");
        // The camera teleports.
        let view = view_at([random.between(-5000.0, 5000.0), random.between(-5000.0, 5000.0)], random.between(0.0, 6.0));
        let settled = select(&world, &view, |_| true);
        // The requests of the last frames, the oldest first.
        let mut requests: VecDeque<BTreeSet<NodeId>> = VecDeque::new();
        let mut frames = 0;
        loop {
            let before = arrivals.arrived().clone();
            let selection = frame(&world, &mut arrivals, &view);
            assert_covers(&selection.drawn);
            if selection.wanted.is_empty() {
                assert_eq!((set(&selection.drawn), arrivals.pending()), (set(&settled.drawn), 0));
                break;
            }
            frames += 1;
            // The expected requests: of the wanted nodes that have neither arrived nor been requested, the 6 most urgent.
            let mut wanted: Vec<&Wanted> =
                selection.wanted.iter().filter(|w| !w.is_available && !requests.iter().any(|nodes| nodes.contains(&w.node))).collect();
            wanted.sort_by(|a, b| {
                let key = |w: &Wanted| (!w.is_in_view, w.distance.to_bits(), 5 - w.node.lod, w.node.parent(), w.node);
                key(a).cmp(&key(b))
            });
            requests.push_back(wanted.iter().take(6).map(|wanted| wanted.node).collect());
            let arrived: BTreeSet<NodeId> = arrivals.arrived().difference(&before).copied().collect();
            // A node that was requested in frame f can be drawn in frame f + 4, so it arrives at the end of frame f + 3.
            let due = if requests.len() == 4 { requests.pop_front().expect("four") } else { BTreeSet::new() };
            assert_eq!(arrived, due, "round {round}, frame {frames}");
            assert_eq!(arrivals.pending(), requests.iter().map(BTreeSet::len).sum::<usize>());
            assert!(arrivals.arrived().len() <= CAPACITY as usize && NodeId::roots().all(|root| arrivals.arrived().contains(&root)));
        }
        // Smallest number of frames that load the missing nodes of the view, at 6 per frame. A node can be drawn 4 frames after its request. The 25
        // root nodes have always arrived.
        let fewest = settled.visited.len().saturating_sub(25 + start_nodes(&world, &start, &settled)).div_ceil(6) + 3;
        assert_eq!(frames, fewest, "round {round}: {} nodes", settled.visited.len());
    }
}

/// Number of the nodes, without the roots, that both the view `start` and the selection `settled` visit.
fn start_nodes(world: &World, start: &View, settled: &Selection) -> usize {
    let first = set(&select(world, start, |_| true).visited);
    settled.visited.iter().filter(|node| node.lod < 5 && first.contains(node)).count()
}

#[test]
fn nodes_that_were_visited_recently_are_kept() {
    let world = built_in_world();
    let here = view_at([100.0, 100.0], 0.0);
    let mut arrivals = Arrivals::new(SCHEDULE, select(&world, &here, |_| true).visited);
    // The camera moves a little and returns. The atlases have room for the nodes of both places, so no node of the first place is replaced.
    let there = view_at([164.0, 100.0], 0.0);
    while !frame(&world, &mut arrivals, &there).wanted.is_empty() {}
    assert_eq!(lag(&frame(&world, &mut arrivals, &here)), Lag::default());
    // During a flight of 4 km, the nodes of the start are replaced, because they are the least recently visited.
    for step in 0..400 {
        frame(&world, &mut arrivals, &view_at([100.0 + 10.0 * f64::from(step), 100.0], 0.0));
        assert!(arrivals.arrived().len() <= CAPACITY as usize);
    }
    assert_eq!(arrivals.arrived().len(), CAPACITY as usize, "the atlases are full");
    assert!(frame(&world, &mut arrivals, &here).wanted.len() > 100);
}

#[test]
fn arrivals_never_replace_nodes_of_the_last_frame() {
    // Two cameras that are far apart take turns. Together they need more nodes than fit into the atlases. The nodes that a frame has visited must not
    // be replaced at the end of this frame.
    let world = built_in_world();
    let views = [view_at([-3000.0, -3000.0], 0.0), view_at([3000.0, 3000.0], 0.0)];
    let mut arrivals = Arrivals::new(Schedule { nodes_per_frame: 64, latency_frames: 1 }, []);
    for number in 0..400 {
        let selection = frame(&world, &mut arrivals, &views[number / 3 % 2]);
        assert_covers(&selection.drawn);
        assert!(selection.visited.iter().all(|node| arrivals.arrived().contains(node)), "frame {number}");
        assert!(arrivals.arrived().len() <= CAPACITY as usize);
    }
}
