//! Makes a scene from a heightmap file: `scene_folder` writes materials, rules and cameras that suit the terrain, `materials` finds
//! materials in folders of images, `viewpoints` finds the cameras. [`decode`](crate::decode) reads the heightmap file.

pub mod materials;
pub mod scene_folder;
pub mod viewpoints;
