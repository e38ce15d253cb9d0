"""Level of detail: thinned meshes whose distance from the full ones is known."""
