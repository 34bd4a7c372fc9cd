//! Tests of the cache on disk (`kernels::base::cache`): nodes and textures from the cache equal those that are made, whatever happens to its files.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, SystemTime};

use kernels::base::cache::{Cache, CacheCounts};
use kernels::materials::Palette;
use kernels::scene::{self, Scene, Stroke, StrokeKind};
use kernels::world::payload::PAYLOAD_BYTES;
use kernels::world::{Baked, Cover, NodeId, NodePayload, PaletteMeans, World};

use crate::fixtures::{self, Folder, has, small_scene};

const NODES: [NodeId; 4] =
    [NodeId { lod: 0, x: 81, y: 79 }, NodeId { lod: 3, x: 9, y: 10 }, NodeId { lod: 4, x: 5, y: 4 }, NodeId { lod: 5, x: 2, y: 2 }];

fn means(scene: &Scene) -> PaletteMeans {
    let count = scene.materials.len();
    let grey = |index: usize| [0.1 + 0.05 * index as f32; 3];
    PaletteMeans { albedo: (0..count).map(grey).collect(), smoothness: vec![0.3; count], specular_occlusion: vec![0.9; count] }
}

fn cache(folder: &Folder) -> Arc<Cache> {
    Arc::new(Cache::new(folder.0.join("cache"), u64::MAX))
}

/// Two payloads of a node, each with its cover: those that were returned, and those that are made from the ground that was returned.
type Made = [(NodePayload, Cover); 2];

/// A damage: its name, and the bytes of an entry after it.
type Damage<'a> = (&'a str, &'a dyn Fn(usize) -> Vec<u8>);

/// Bakes nodes with a cache or without.
fn bake(scene: &Scene, means: &PaletteMeans, cache: Option<&Arc<Cache>>, nodes: &[NodeId]) -> Vec<Made> {
    let world = World::new(scene).expect("valid").with_cache(cache.cloned());
    let nodes: Vec<NodeId> = nodes.iter().copied().filter(|node| world.exists(*node)).collect();
    let all = |baked: Baked| {
        let ground = baked.ground.expect("asked for");
        let cover = world.cover(&ground);
        let payload = world.dress(&ground, &cover, means);
        [(baked.payload, baked.cover), (payload, cover)]
    };
    world.bake_many(&nodes, means, true, || ()).into_iter().map(all).collect()
}

/// The files of a cache, in the order of their paths.
fn entries(cache: &Cache) -> Vec<PathBuf> {
    let inside = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().map(|entry| entry.expect("readable").path());
    let mut entries: Vec<PathBuf> = inside(cache.folder().to_owned()).flat_map(inside).collect();
    entries.sort();
    entries
}

#[test]
fn nodes_from_the_cache_are_those_that_are_baked() {
    let folder = Folder::new("cache-equal");
    for scene in [small_scene(), fixtures::island(&folder)] {
        let (cache, means) = (cache(&folder), means(&scene));
        let expected = bake(&scene, &means, None, &NODES);
        let count = expected.len();
        assert!(count > 1);
        assert!(bake(&scene, &means, Some(&cache), &NODES) == expected, "nodes differ when they are baked for the cache");
        assert_eq!(cache.counts(), CacheCounts { read: 0, written: 2 * count });
        // A second cache stands for a second process.
        let cache = self::cache(&folder);
        assert!(bake(&scene, &means, Some(&cache), &NODES) == expected, "nodes differ when they are read from the cache");
        assert_eq!(cache.counts(), CacheCounts { read: 2 * count, written: 0 });
        // Without the ground, its entries are not read.
        World::new(&scene).expect("valid").with_cache(Some(cache.clone())).bake_many(&NODES[2..], &means, false, || ());
        assert_eq!(cache.counts(), CacheCounts { read: 2 * count + 2, written: 0 });
        assert_eq!(cache.problem(), None);
    }
}

#[test]
fn textures_from_the_cache_are_those_that_are_made() {
    let folder = Folder::new("cache-textures");
    let cache = cache(&folder);
    let scene = small_scene();
    let with = |contrast: f64| Scene { blend: scene::Blend { material_contrast: contrast, ..scene.blend.clone() }, ..scene.clone() };
    let mut layers = 0;
    for (scene, size) in [(with(1.0), 64), (with(1.0), 128), (with(1.5), 64)] {
        let expected = Palette::sketch(&scene, size, 64.0, |_| Ok(())).expect("procedural textures");
        let before = cache.counts();
        for is_first in [true, false] {
            let found = Palette::kept(&scene, size, 64.0, Some(&cache), |_| Ok(())).expect("procedural textures");
            assert!(
                found.arrays == expected.arrays && found.entries == expected.entries && found.means == expected.means,
                "{size}, {is_first}"
            );
        }
        layers = expected.arrays.albedo.len();
        assert_eq!(cache.counts(), CacheCounts { read: before.read + layers, written: before.written + layers });
    }
    assert!(layers > 1 && entries(&cache).len() == 3 * layers, "{layers} layers");
    assert_eq!(cache.problem(), None);
}

#[test]
fn whatever_changes_a_node_changes_its_entry() {
    let folder = Folder::new("cache-keys");
    let first = small_scene();
    let mut others = vec![(first.clone(), means(&first))];
    let mut add = |change: &dyn Fn(&mut Scene, &mut PaletteMeans)| {
        let (mut scene, mut means) = (first.clone(), means(&first));
        change(&mut scene, &mut means);
        others.push((scene, means));
    };
    add(&|scene, _| {
        let scene::World::Procedural { seed, .. } = &mut scene.world else { panic!("the built-in world is procedural") };
        *seed += 1;
    });
    add(&|scene, _| {
        let scene::World::Procedural { holes, .. } = &mut scene.world else { panic!("the built-in world is procedural") };
        holes.push(scene::Hole { centre: [90.0, -10.0], radius_m: 30.0 });
    });
    add(&|scene, _| {
        let scene::World::Procedural { colour_modulation, .. } = &mut scene.world else { panic!("the built-in world is procedural") };
        *colour_modulation = 0.7;
    });
    add(&|scene, _| scene.rules.truncate(1));
    add(&|scene, _| {
        let material = scene.materials[3].name.clone();
        let points = vec![[70.0, -40.0], [120.0, -20.0]];
        scene.strokes.push(Stroke { kind: StrokeKind::Splat, material, points, radius_m: 9.0, fade_m: 0.0, amount: 0.0 });
    });
    add(&|_, means| means.albedo.iter_mut().for_each(|albedo| albedo[1] += 0.2));
    add(&|_, means| means.smoothness.iter_mut().for_each(|smoothness| *smoothness += 0.1));
    add(&|_, means| means.specular_occlusion.iter_mut().for_each(|occlusion| *occlusion -= 0.1));
    for fade_m in [0.0, 300.0] {
        add(&|scene, _| {
            let (material, points) = (scene.materials[3].name.clone(), vec![[0.0, 0.0], [400.0, 0.0]]);
            scene.strokes.push(Stroke { kind: StrokeKind::Mask, material, points, radius_m: 300.0, fade_m, amount: 50.0 });
        });
    }
    // Heightmaps that differ in their scale, in added relief, and (at the end of this test) in one sample.
    let island = fixtures::island(&folder);
    let scaled = |(detail, wider, higher): (f64, f64, f64)| {
        let mut scene = island.clone();
        let scene::World::Heightmap { detail_m, metres_per_texel, height_range_m, .. } = &mut scene.world else {
            panic!("an import has a heightmap")
        };
        *detail_m = detail;
        *metres_per_texel *= wider;
        height_range_m[1] += higher;
        scene
    };
    let means_of_island = means(&island);
    let scales = [(0.0, 1.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.01, 0.0), (0.0, 1.0, 10.0)];
    others.extend(scales.map(|change| (scaled(change), means_of_island.clone())));
    let cache = cache(&folder);
    let mut seen = Vec::new();
    let mut check = |scene: &Scene, means: &PaletteMeans, what: &str| {
        let expected = bake(scene, means, None, &NODES);
        assert!(seen.iter().all(|before| *before != expected), "{what} changes no node, so the test cannot fail");
        assert!(bake(scene, means, Some(&cache), &NODES) == expected, "{what}: a node was read that was baked from other data");
        seen.push(expected);
    };
    for (index, (scene, means)) in others.iter().enumerate() {
        check(scene, means, &format!("change {index}"));
    }
    let [path] = &island.sources()[..1] else { panic!("a scene with a heightmap reads a file") };
    let image = image::open(path).expect("the import wrote an image");
    let mut image = image.into_luma16();
    let middle = [image.width() / 2, image.height() / 2];
    image.get_pixel_mut(middle[0], middle[1]).0[0] ^= 0x0800;
    image.save(path).expect("writable");
    check(&island, &means_of_island, "an edited sample of the heightmap");
}

#[test]
fn an_edited_world_reads_the_ground_and_keeps_no_payload() {
    let folder = Folder::new("cache-edit");
    let (cache, scene) = (cache(&folder), small_scene());
    let means = means(&scene);
    let world = World::new(&scene).expect("valid").with_cache(Some(cache.clone()));
    world.bake_many(&NODES, &means, false, || ());
    let mut edited = scene.clone();
    edited.rules.truncate(1);
    let expected = bake(&edited, &means, None, &NODES);
    let before = cache.counts();
    let done = AtomicUsize::new(0);
    let count = || {
        done.fetch_add(1, Ordering::Relaxed);
    };
    let found = world.laid_by(&edited).bake_many(&NODES, &means, false, count);
    assert!(found.into_iter().map(|baked| (baked.payload, baked.cover)).eq(expected.into_iter().map(|[first, _]| first)));
    assert_eq!(cache.counts(), CacheCounts { read: before.read + NODES.len(), ..before });
    assert_eq!(done.into_inner(), NODES.len(), "a node from the cache is not reported as done");
}

#[test]
fn damaged_entries_are_baked_again() {
    let folder = Folder::new("cache-damage");
    let scene = small_scene();
    let means = means(&scene);
    let nodes = &NODES[2..];
    let expected = bake(&scene, &means, None, nodes);
    bake(&scene, &means, Some(&cache(&folder)), nodes);
    let entries = entries(&cache(&folder));
    let whole: Vec<Vec<u8>> = entries.iter().map(|entry| fs::read(entry).expect("readable")).collect();
    assert_eq!(entries.len(), 4, "{entries:?}");
    assert!(whole.iter().any(|bytes| (PAYLOAD_BYTES..2 * PAYLOAD_BYTES).contains(&bytes.len())));
    let damages: [Damage<'_>; 7] = [
        ("empty", &|_| Vec::new()),
        ("cut", &|index| whole[index][..whole[index].len() / 2].to_vec()),
        ("cut by the checksum", &|index| whole[index][..whole[index].len() - 8].to_vec()),
        ("longer", &|index| [whole[index].clone(), vec![0; 8]].concat()),
        ("one bit", &|index| whole[index].iter().enumerate().map(|(at, byte)| byte ^ u8::from(at == whole[index].len() / 2)).collect()),
        // Entries 0 and 1 are of one kind and of two nodes, and so are 2 and 3.
        ("another node", &|index| whole[index ^ 1].clone()),
        ("another kind", &|index| whole[index ^ 2].clone()),
    ];
    for (what, damaged) in damages {
        for (index, entry) in entries.iter().enumerate() {
            fs::write(entry, damaged(index)).expect("writable");
        }
        let cache = cache(&folder);
        assert!(bake(&scene, &means, Some(&cache), nodes) == expected, "{what}: a damaged entry was used");
        assert_eq!(cache.counts(), CacheCounts { read: 0, written: 4 }, "{what}");
        for (entry, whole) in entries.iter().zip(&whole) {
            assert!(fs::read(entry).expect("readable") == *whole, "{what}: {} is still damaged", entry.display());
        }
    }
}

#[test]
fn the_oldest_entries_go_when_the_cache_is_full() {
    let folder = Folder::new("cache-full");
    let scene = small_scene();
    let (means, limit) = (means(&scene), 3_000_000);
    let cache = Arc::new(Cache::new(folder.0.join("cache"), limit));
    let size = |cache: &Cache| entries(cache).iter().map(|entry| fs::metadata(entry).expect("readable").len()).sum::<u64>();
    let last = NodeId { lod: 5, x: 4, y: 2 };
    // Old files that the cache did not write, and one that was left behind by a process that was killed.
    let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    let make_old = |path: &Path| fs::File::options().write(true).open(path).and_then(|file| file.set_modified(long_ago)).expect("writable");
    let [photos, key, empty] = ["photos", "0123456789abcdef", "empty"].map(|name| cache.folder().join(name));
    [&photos, &key, &empty].into_iter().for_each(|folder| fs::create_dir_all(folder).expect("writable"));
    let foreign = [photos.join("3-9-10"), key.join("letter.txt")];
    let abandoned = key.join("3-9-10.4711-0.tmp");
    for file in foreign.iter().chain([&abandoned]) {
        fs::write(file, "old").expect("writable");
        make_old(file);
    }
    let mut largest = 0;
    for y in 0..3 {
        for x in 0..5 {
            bake(&scene, &means, Some(&cache), &[NodeId { lod: 5, x, y }]);
            largest = largest.max(size(&cache));
        }
    }
    // A node has two entries, together 330 KB. The size is checked after every 1/16 of the limit, which is less than an entry of a ground.
    assert!(largest > limit / 2 && largest <= limit + 330_000, "{largest} bytes, with a limit of {limit}");
    let before = cache.counts();
    bake(&scene, &means, Some(&cache), &[last]);
    assert_eq!(cache.counts(), CacheCounts { read: before.read + 2, ..before }, "the last node was removed");
    // An entry that is read is not old, even if it was written long ago.
    entries(&cache).iter().for_each(|entry| make_old(entry));
    bake(&scene, &means, Some(&cache), &[last]);
    for x in 0..3 {
        bake(&scene, &means, Some(&cache), &[NodeId { lod: 5, x, y: 4 }]);
    }
    let before = cache.counts();
    bake(&scene, &means, Some(&cache), &[last]);
    assert_eq!(cache.counts(), CacheCounts { read: before.read + 2, ..before }, "the node that was read was removed as an old one");
    assert!(foreign.iter().chain([&empty]).all(|path| path.exists()), "a foreign file was removed");
    assert!(!abandoned.exists(), "a temporary file of a killed process is kept");
}

#[test]
fn a_folder_that_cannot_be_written_is_named_and_costs_only_time() {
    let folder = Folder::new("cache-problem");
    folder.write("cache", "a file where the folder should be");
    let scene = small_scene();
    let means = means(&scene);
    let cache = cache(&folder);
    assert!(bake(&scene, &means, Some(&cache), &NODES[3..]) == bake(&scene, &means, None, &NODES[3..]));
    let problem = cache.problem().expect("nothing was written");
    has(problem, &[&folder.path("cache"), "SCREE_CACHE", "`off`"]);
    assert!(!problem.contains('\n'), "{problem}");
    // The program says it once, after its work.
    let arguments = ["render", "--camera", "cliff", "--size", "16x16", "--out", &folder.path("picture.png")];
    let output = Command::new(fixtures::program()).args(arguments).env("SCREE_CACHE", folder.path("cache")).output().expect("starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    let notes = stderr.lines().filter(|line| line.starts_with("note: nodes and textures are not kept"));
    assert!(output.status.success() && notes.count() == 1, "{stderr}");
    assert_eq!(cache.counts(), CacheCounts::default());
}

#[test]
fn several_processes_can_share_a_cache() {
    let folder = Folder::new("cache-shared");
    let scene = small_scene();
    let means = means(&scene);
    let expected = bake(&scene, &means, None, &NODES[2..]);
    std::thread::scope(|scope| {
        // Each thread has its own cache, so they share nothing but the folder. The small limit lets them remove each other's entries.
        let user = |limit: u64| {
            let cache = Arc::new(Cache::new(folder.0.join("cache"), limit));
            let is_same = (0..4).all(|_| bake(&scene, &means, Some(&cache), &NODES[2..]) == expected);
            (is_same, cache.problem().map(str::to_owned))
        };
        let threads = [100_000, 700_000, u64::MAX].map(|limit| scope.spawn(move || user(limit)));
        for thread in threads {
            assert_eq!(thread.join().expect("no panic"), (true, None));
        }
    });
}
