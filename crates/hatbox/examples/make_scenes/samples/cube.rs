//! The closed unit cube whose ceiling shines with B⁰ = 1. Mean radiosities are known: at R = ½ throughout, floor
//! 0.171215, ceiling 1.104364, walls 0.181105; at R = 0.8, floor 0.660976, ceiling 1.587514, walls 0.687878.

pub(super) const OBJ: &str = "\
# Closed unit cube, seen from inside; the ceiling emits.
mtllib cube.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
usemtl white
o floor
f 1 2 3 4
o wall_y0
f 1 5 6 2
o wall_x1
f 2 6 7 3
o wall_y1
f 3 7 8 4
o wall_x0
f 4 8 5 1
usemtl ceiling
o ceiling
f 5 8 7 6
";

pub(super) const MTL: &str = "\
newmtl white
Kd 0.5 0.5 0.5
Ke 0 0 0

# Ke is a radiance: B0 = pi Ke = 1.
newmtl ceiling
Kd 0.5 0.5 0.5
Ke 0.3183098861837907 0.3183098861837907 0.3183098861837907
";

pub(super) const TOML: &str = "\
# The cube of cube.obj in brighter paint: the scene file overrides the materials of the mesh, by name.
unit = \"m\"

[[mesh]]
file = \"cube.obj\"

[material.\"*\"]
reflectance = 0.8

[material.ceiling]
exitance = 1.0 # lm/m2

[camera]
eye = [0.5, 0.02, 0.5]
target = [0.5, 1.0, 0.45]
up = [0, 0, 1]
fov = 75
";
