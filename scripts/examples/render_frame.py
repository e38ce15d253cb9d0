"""Draw the model over a camera's picture of one frame: render_frame.py RESULT TAKE CAMERA FRAME PICTURE."""

import sys
from pathlib import Path

import cv2

from services.mocap import draw_frame, load_result, open_take

result_folder, take_folder, camera, frame, picture = sys.argv[1:]
result, take = load_result(result_folder), open_take(Path(take_folder))
drawn = draw_frame(result, take, camera, int(frame), width_px=960)
cv2.imwrite(picture, drawn)
