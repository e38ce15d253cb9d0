// One invocation per image and edge: an edge between a front and a back face adds +1 or -1 where it crosses a pixel
// row. The cpu backend's crossing.py explains why, and has the same integer arithmetic.
layout(std430, binding = 0) readonly buffer Shown { uint shown[]; };  // (I, S)
layout(std430, binding = 1) readonly buffer Chunks { uvec4 chunks[]; };  // slot, first edge, count, first of uv
layout(std430, binding = 2) readonly buffer Edges { uvec2 edges[]; };  // (2, E) ends a, b; faces' corners c, d
layout(std430, binding = 3) readonly buffer Snapped { ivec2 uv[]; };  // (I, V drawn)
layout(std430, binding = 4) buffer Winding { int winding[]; };  // (I, W, H)
layout(std430, binding = 5) buffer Spans { ivec2 spans[]; };  // (I, H) first and last column + 1 touched

// Twice the area of a triangle; negative where it runs counter-clockwise on the screen, y pointing down.
int64_t area(ivec2 a, ivec2 b, ivec2 c) {
    return int64_t(b.x - a.x) * int64_t(c.y - a.y) - int64_t(c.x - a.x) * int64_t(b.y - a.y);
}

void main() {
    uvec4 chunk = chunks[gl_WorkGroupID.x];
    uint image = gl_WorkGroupID.y, i = gl_LocalInvocationID.x;
    if (shown[image * n_slots + chunk.x] == 0u || i >= chunk.z) return;
    uvec2 ends = edges[chunk.y + i];
    uint base = image * n_vertices + chunk.w;
    ivec2 a = uv[base + ends.x], b = uv[base + ends.y];
    bool down = a.y < b.y;
    ivec2 top = down ? a : b, way = down ? b - a : a - b;
    int first = max((top.y + SUBPIXEL - 1) >> SUBPIXEL_BITS, 0);
    int last = min((top.y + way.y + SUBPIXEL - 1) >> SUBPIXEL_BITS, height_px);
    if (first >= last || a.x == BEHIND || b.x == BEHIND) return;
    uvec2 corners = edges[uint(edges.length()) / 2u + chunk.y + i];
    ivec2 c = uv[base + corners.x], d = uv[base + corners.y];
    bool along = c.x != BEHIND && area(a, b, c) < 0, against = d.x != BEHIND && area(a, b, d) > 0;
    if (along == against) return;
    int turn = down == along ? 1 : -1;
    int64_t divisor = int64_t(way.y) << SUBPIXEL_BITS, step = int64_t(way.x) << SUBPIXEL_BITS;
    int64_t crossing = int64_t(top.x) * way.y + int64_t((first << SUBPIXEL_BITS) - top.y) * way.x;
    for (int row = first; row < last; ++row, crossing += step) {
        if (crossing > divisor * (width_px - 1)) continue;  // right of the picture
        // The first column whose centre is not left of the crossing. Float division gives this column or the one
        // before, or a neighbour where division is not rounded correctly.
        int column = crossing > 0 ? int(double(crossing) / double(divisor)) : 0;
        while (divisor * column < crossing) ++column;
        while (column > 0 && divisor * (column - 1) >= crossing) --column;
        atomicAdd(winding[winding_index(image, column, uint(row))], turn);
        uint span = image * uint(height_px) + uint(row);
        atomicMin(spans[span].x, column);
        atomicMax(spans[span].y, column + 1);
    }
}
