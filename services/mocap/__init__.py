"""The motion-capture library that the services share: no sockets, no processes, no global state.

Conventions everywhere inside: metres, radians, seconds; right-handed world with z up; the body's own
frame has x forward, y to its left, z up; pixel centres lie at whole coordinates (OpenCV's convention).
A take whose world is y-up is turned to z-up when it is read and back when results are written.
"""

from services.mocap.compiled import keep_compiled_code

keep_compiled_code()
