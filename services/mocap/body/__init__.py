"""The body: skeleton, segment shapes, pose and actor."""
