"""Compare two results of one take, joint by joint: compare.py RESULT RESULT."""

import sys

import numpy as np

from services.mocap import REFERENCE_JOINTS, load_result

one, other = load_result(sys.argv[1]), load_result(sys.argv[2])
frames, rows_one, rows_other = np.intersect1d(one.frames, other.frames, return_indices=True)
if not frames.size:
    sys.exit("the two results have no frame in common")

# (N, 15, 3) metres in the z-up world
apart_m = np.linalg.norm(one.joints_world_m[rows_one] - other.joints_world_m[rows_other], axis=-1)
print(f"{len(frames)} frames in common, joints {1000 * apart_m.mean():.1f} mm apart in the mean")
for joint, distances_m in zip(REFERENCE_JOINTS, apart_m.T, strict=True):
    worst = int(distances_m.argmax())
    mean_mm, worst_mm = 1000 * distances_m.mean(), 1000 * distances_m[worst]
    print(f"{joint:15s} {mean_mm:6.1f} mm, at most {worst_mm:6.1f} mm in frame {frames[worst]}")
