"""The `cpu` backend: outlines instead of triangles, sums instead of pictures."""
