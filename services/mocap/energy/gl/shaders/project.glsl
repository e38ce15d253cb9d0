// One invocation per image and vertex: the vertex in steps of 1/256 pixel, as defined in snapping.py.
layout(std430, binding = 0) readonly buffer Views { dvec4 M_px_segment[]; };  // (I, S, 3)
layout(std430, binding = 1) readonly buffer Shown { uint shown[]; };  // (I, S)
layout(std430, binding = 2) readonly buffer Chunks { uvec4 chunks[]; };  // slot, first vertex, count, first of uv
layout(std430, binding = 3) readonly buffer Vertices { double xyz_m[]; };  // (V, 3)
layout(std430, binding = 4) writeonly buffer Snapped { ivec2 uv[]; };  // (I, V drawn)

int snap(double homogeneous, double steps_per_depth) {
    precise double steps = homogeneous * steps_per_depth;
    return int(roundEven(clamp(steps, -LIMIT_STEPS, LIMIT_STEPS)));
}

void main() {
    uvec4 chunk = chunks[gl_WorkGroupID.x];
    uint image = gl_WorkGroupID.y, i = gl_LocalInvocationID.x;
    uint view = image * n_slots + chunk.x, m = 3u * view;
    if (shown[view] == 0u || i >= chunk.z) return;
    uint v = 3u * (chunk.y + i);
    double x = xyz_m[v], y = xyz_m[v + 1u], z = xyz_m[v + 2u];
    precise double h[3];
    for (uint k = 0u; k < 3u; ++k) {
        dvec4 row = M_px_segment[m + k];
        h[k] = row.x * x + row.y * y + row.z * z + row.w;
    }
    precise double steps_per_depth = double(SUBPIXEL) / max(h[2], NEAR_M);
    int column = h[2] < NEAR_M ? BEHIND : snap(h[0], steps_per_depth);
    uv[image * n_vertices + chunk.w + i] = ivec2(column, snap(h[1], steps_per_depth));
}
