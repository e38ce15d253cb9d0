"""Motion as a whole: what is done to the poses of many frames."""
