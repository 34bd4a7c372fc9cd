//! Makes a scene from a heightmap file: `scene_folder` writes materials, rules and cameras that suit the terrain, `viewpoints` finds the
//! cameras. [`decode`](crate::decode) reads the file itself.

pub mod scene_folder;
pub mod viewpoints;
