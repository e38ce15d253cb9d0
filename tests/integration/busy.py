"""Options of the search for tests of something else."""

ONE_WAY = ("--set", "both_ways=false")
"""A third of the work."""
BUSY = ("--set", 'search_limbs="always"')
"""Every worker has something to do in every frame."""
SHORT = ("--no-check", "--no-overlay", *ONE_WAY)
"""For the whole command: nothing but poses, whatever the take looks like."""
SMALL_GRIDS = ("--set", "arm_grid=[3, 3, 1, 3]", "--set", "leg_grid=[3, 1, 1, 3]", "--set", "max_passes=1")
"""A tenth of the evaluations of a limb search."""
