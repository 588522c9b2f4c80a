"""Own terrain from many formats: height maps, point clouds, meshes, planar regions, boxes."""
