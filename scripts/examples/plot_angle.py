"""Load a result and plot a joint angle: plot_angle.py RESULT PICTURE [ANGLE], such as knee_flexion."""

import sys

from matplotlib.figure import Figure

from services.mocap import load_result

result = load_result(sys.argv[1])
angle = sys.argv[3] if len(sys.argv) > 3 else "knee_flexion"

figure = Figure((8, 3), layout="constrained")
axes = figure.subplots()
for side, colour in (("left", "tab:orange"), ("right", "tab:blue")):
    axes.plot(result.times_s, result.angles_deg[f"{side}_{angle}"], color=colour, label=side)
for time_s in result.times_s[result.distrusted.any(axis=1)]:
    axes.axvline(time_s, color="red", alpha=0.2)
axes.set(xlabel="time (s)", ylabel=f"{angle.replace('_', ' ')} (°)")
axes.legend()
figure.savefig(sys.argv[2])
