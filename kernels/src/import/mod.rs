//! A heightmap file becomes a scene: `scene_folder` writes materials, rules and cameras that suit the land, `viewpoints` finds the cameras.
//! Reading the file itself is the task of [`decode`](crate::decode).

pub mod scene_folder;
pub mod viewpoints;
