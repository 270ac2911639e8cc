//! The sample scenes as files: the same bytes on every machine, so that a test can compare them with what is checked in.

mod cornell;
mod cube;
mod glb;
mod rooms;

/// Name and content of every file in `scenes/`.
pub(crate) fn all() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("cornell-box.glb", cornell::scene().to_glb()),
        ("two-rooms.glb", rooms::scene(rooms::Door::Open).to_glb()),
        ("two-rooms-walled.glb", rooms::scene(rooms::Door::WalledUp).to_glb()),
        ("cube.obj", cube::OBJ.into()),
        ("cube.mtl", cube::MTL.into()),
        ("cube.toml", cube::TOML.into()),
    ]
}
