"""Estimates how the camera hangs on the rig from pictures of any fixed, textured target taken at known moves."""
