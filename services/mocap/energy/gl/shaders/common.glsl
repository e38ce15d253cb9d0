// Shared by all kernels. The host code puts before it the version, the extension and the constants of snapping.py:
// SUBPIXEL, SUBPIXEL_BITS, NEAR_M, LIMIT_STEPS, GROUP. An image is one pose seen by one camera.
layout(local_size_x = GROUP) in;

layout(std140, binding = 0) uniform Part {
    uint n_images;
    uint first_camera;  // camera of the part's first image; the others follow, camera by camera and pose by pose
    uint n_cameras;
    uint n_slots;  // segments drawn
    uint n_vertices;  // vertices of these segments
    int width_px;
    int height_px;
};

const int BEHIND = int(0x80000000);  // replaces a vertex's x if it is nearer than the near plane
const int NO_COLUMN = 0x7fffffff;

uint camera_of(uint image) { return (first_camera + image) % n_cameras; }

uint pose_of(uint image) { return (first_camera + image) / n_cameras; }

// Winding is stored by columns: neighbouring invocations read neighbouring rows, which are then adjacent in memory.
uint winding_index(uint image, int column, uint row) {
    return (image * uint(width_px) + uint(column)) * uint(height_px) + row;
}
