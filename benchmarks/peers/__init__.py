"""Ours beside what else there is, in one run: pose (``peers.pose``) and place recognition (``peers.castle``)."""
