"""The `paper` backend: an OpenGL rasteriser whose whole picture is read back and counted on the CPU.

It spends its time where Theobalt et al. 2003 spent theirs (section 4.1), so that their table 1 can be set
beside today's machines. It is not for tracking.
"""
