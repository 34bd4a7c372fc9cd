//! Makes a scene from a heightmap file: `scene_folder` writes materials, rules and cameras that suit the terrain, `materials` finds
//! materials in folders of images, `viewpoints` finds the cameras, `role` derives the role of a material from its name.
//! [`decode`](crate::decode) reads the heightmap file.

pub mod materials;
mod role;
pub mod scene_folder;
pub mod viewpoints;
