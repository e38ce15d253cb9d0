// One invocation per image and pixel row: sets a bit for every covered pixel, and clears the row's winding.
layout(std430, binding = 0) buffer Winding { int winding[]; };  // (I, W, H)
layout(std430, binding = 1) buffer Spans { ivec2 spans[]; };  // (I, H)
layout(std430, binding = 2) writeonly buffer Covered { uint covered[]; };  // (I, H, W / 32 rounded up)

void main() {
    uint s = gl_GlobalInvocationID.x, image = s / uint(height_px), row = s % uint(height_px);
    if (image >= n_images) return;
    ivec2 span = spans[s];
    spans[s] = ivec2(NO_COLUMN, 0);
    int depth = 0, n_words = (width_px + 31) / 32;
    for (int k = 0; k < n_words; ++k) {
        uint word = 0u;
        for (int x = 32 * k; x < min(32 * k + 32, width_px); ++x) {
            if (x >= span.x && x < span.y) {
                uint w = winding_index(image, x, row);
                depth += winding[w];
                winding[w] = 0;
            }
            word |= uint(depth > 0) << uint(x - 32 * k);
        }
        covered[s * uint(n_words) + uint(k)] = word;
    }
}
