// One invocation per image and pixel row: adds the gain of the covered pixels to the image's sum, and clears the row's
// winding.
layout(std430, binding = 0) buffer Winding { int winding[]; };  // (I, W, H)
layout(std430, binding = 1) buffer Spans { ivec2 spans[]; };  // (I, H)
layout(std430, binding = 2) readonly buffer Gains { int gain_sums[]; };  // (C, W + 1, H) prefix sums of the gain
layout(std430, binding = 3) buffer Sums { uvec2 sums[]; };  // (I,) low and high word

void main() {
    uint s = gl_GlobalInvocationID.x, image = s / uint(height_px), row = s % uint(height_px);
    if (image >= n_images) return;
    ivec2 span = spans[s];
    if (span.x >= span.y) return;
    spans[s] = ivec2(NO_COLUMN, 0);
    uint gains = camera_of(image) * uint(width_px + 1) * uint(height_px) + row;
    int depth = 0, total = 0;
    for (int x = span.x; x < span.y; ++x) {
        uint w = winding_index(image, x, row);
        int turns = winding[w];
        if (turns == 0) continue;
        winding[w] = 0;
        int was_covered = int(depth > 0);
        depth += turns;
        total += (was_covered - int(depth > 0)) * gain_sums[gains + uint(x) * uint(height_px)];
    }
    if (depth > 0) total += gain_sums[gains + uint(width_px) * uint(height_px)];
    uint low = uint(total), before = atomicAdd(sums[image].x, low);
    uint high = (total < 0 ? 0xffffffffu : 0u) + uint(before + low < low);
    if (high != 0u) atomicAdd(sums[image].y, high);
}
