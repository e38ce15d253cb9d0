// One invocation per image and segment: how the camera sees the segment.
layout(std430, binding = 0) readonly buffer Transforms { double T_world_segment[]; };  // (N, S, 3, 4)
layout(std430, binding = 1) readonly buffer Cameras { double P_px_world[]; };  // (C, 3, 4)
layout(std430, binding = 2) readonly buffer Spheres { double spheres_m[]; };  // (S, 4) centre and radius
layout(std430, binding = 3) writeonly buffer Views { double M_px_segment[]; };  // (I, S, 3, 4)
layout(std430, binding = 4) writeonly buffer Shown { uint shown[]; };  // (I, S)
layout(std430, binding = 5) writeonly buffer Sums { uvec2 sums[]; };  // (I,) low and high word

// Whether the sphere lies completely on the outer side of one edge of the picture. A closed outline there crosses no
// row of the picture, or crosses each row as often up as down at the same place, and so covers nothing.
bool beyond(dvec4 at, dvec4 row, dvec4 depth_row, double radius, double size_px) {
    dvec4 before = row + 2.0 * depth_row, after = row - (size_px + 1.0) * depth_row;
    return -dot(before, at) > radius * length(before.xyz) || dot(after, at) > radius * length(after.xyz);
}

void main() {
    uint view = gl_GlobalInvocationID.x;
    if (view >= n_images * n_slots) return;
    uint image = view / n_slots, slot = view % n_slots;
    uint p = 12u * camera_of(image), t = 12u * (pose_of(image) * n_slots + slot);
    double M[12];  // an array: NVIDIA's compiler cannot index a dvec4 by a variable
    for (uint i = 0u; i < 3u; ++i)
        for (uint j = 0u; j < 4u; ++j) {
            uint k = p + 4u * i;
            // The same order of operations as in the cpu backend, without fused multiplication: equal to the last bit.
            precise double sum = P_px_world[k] * T_world_segment[t + j]
                + P_px_world[k + 1u] * T_world_segment[t + 4u + j]
                + P_px_world[k + 2u] * T_world_segment[t + 8u + j];
            precise double entry = j == 3u ? sum + P_px_world[k + 3u] : sum;
            M[4u * i + j] = entry;
            M_px_segment[12u * view + 4u * i + j] = entry;
        }
    dvec4 row_x = dvec4(M[0], M[1], M[2], M[3]), row_y = dvec4(M[4], M[5], M[6], M[7]);
    dvec4 row_depth = dvec4(M[8], M[9], M[10], M[11]);
    double radius = spheres_m[4u * slot + 3u];
    dvec4 at = dvec4(spheres_m[4u * slot], spheres_m[4u * slot + 1u], spheres_m[4u * slot + 2u], 1.0);
    double depth_m = dot(row_depth, at), reach_m = radius * length(row_depth.xyz);
    bool hidden = depth_m + 1.000001 * reach_m < 0.999 * NEAR_M;
    if (depth_m - reach_m > 1.000001 * NEAR_M)
        hidden = beyond(at, row_x, row_depth, radius, width_px) || beyond(at, row_y, row_depth, radius, height_px);
    shown[view] = hidden ? 0u : 1u;
    if (slot == 0u) sums[image] = uvec2(0u);
}
