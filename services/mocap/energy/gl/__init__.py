"""The `gl` backend: outlines by compute shaders on OpenGL without a window."""
