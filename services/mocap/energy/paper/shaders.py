"""The two shaders: vertices posed and flattened to their camera's depth; fragments that carry its bit.

Corners are divided by their depth here and not by the rasteriser: with w = 1 and the same z at all three
corners every fragment of a camera has exactly that z, so that the depth test lets one of them pass and no
second one.
"""

from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE
from services.mocap.energy.snapping import NEAR_M

ROWS_PER_MATRIX = 3


def vertex_shader(n_segments: int) -> str:
    """Poses a segment's vertices before the camera that gl_InstanceID counts.

    A corner nearer than NEAR_M goes so far out of the clip volume that clipping cuts its triangle off at the
    corners that stay: nothing of it is left.
    """
    return f"""#version 430
in vec3 xyz_m;
in int segment;
layout(std140, binding = 0) uniform Matrices {{
    vec4 rows[{CAMERAS_PER_PLANE * n_segments * ROWS_PER_MATRIX}];
}};
flat out float bit;

void main() {{
    int first = {ROWS_PER_MATRIX} * ({n_segments} * gl_InstanceID + segment);
    vec4 point = vec4(xyz_m, 1.0);
    float depth_m = dot(rows[first + 2], point);
    vec2 place = vec2(dot(rows[first], point), dot(rows[first + 1], point)) / max(depth_m, {NEAR_M});
    float camera_z = 1.0 - float(gl_InstanceID + 1) / {CAMERAS_PER_PLANE}.0;
    gl_Position = vec4(place, depth_m < {NEAR_M} ? -1e20 : camera_z, 1.0);
    bit = float(1 << gl_InstanceID) / 255.0;
}}
"""


FRAGMENT_SHADER = """#version 430
flat in float bit;
layout(location = 0) out float plane;

void main() {
    plane = bit;
}
"""
